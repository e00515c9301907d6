"""Arguments, exit codes and one-line errors."""
