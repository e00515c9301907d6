"""Exception types: every error a user can cause is a `ClshadeError` with a one-line message."""


class ClshadeError(Exception):
    """Base class of all errors that clshade raises on purpose."""


class InputError(ClshadeError, ValueError):
    """Refused input: names function or file, argument or field, what was expected and found."""


class DeviceError(ClshadeError, RuntimeError):
    """Missing or failed OpenCL device; the message says what to install or change."""


class OutputError(ClshadeError, OSError):
    """Result that could not be written; no partial file is left behind."""


class WorkerError(ClshadeError, RuntimeError):
    """Failure of a process or machine that draws frames, or no connection to it."""

    __notes__: list[str]  # where the worker failed; shown with a traceback
