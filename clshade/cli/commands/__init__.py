"""The commands, a module each: `add_options(parser)` says what it takes, `run(arguments)` does it and returns the exit
code. The command line imports only the one that it names."""

DONE, FAILED, REFUSED, UNREAD = 0, 1, 2, 141  # exit codes; one more in clshade.base.interrupts
