"""The command line: options, exit codes and one-line errors. Only the module of the given command is imported."""

DONE, FAILED, REFUSED, UNREAD = 0, 1, 2, 141  # exit codes; one more in clshade.base.interrupts
