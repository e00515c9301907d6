"""Why a test is not taken."""


class Skipped(Exception):
    """A test that a device cannot take; the message says why."""
