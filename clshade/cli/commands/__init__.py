"""The commands, one module each: `add_options(parser)` defines its options, `run(arguments)` runs it and returns the
exit code. Only the module of the given command is imported."""

DONE, FAILED, REFUSED, UNREAD = 0, 1, 2, 141  # exit codes; one more in clshade.base.interrupts
