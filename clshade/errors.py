"""Exception types. Every error a user can cause is a `ClshadeError`; its text is one line."""


class ClshadeError(Exception):
    """Base of all errors that clshade raises on purpose."""


class InputError(ClshadeError, ValueError):
    """Refused input: names the function or file, the argument or field, what was expected and what was found."""


class DeviceError(ClshadeError, RuntimeError):
    """No usable OpenCL device, or the device failed; says what to install or change."""


class OutputError(ClshadeError, OSError):
    """A result could not be written; nothing half-written is left behind."""


class WorkerError(ClshadeError, RuntimeError):
    """A process or machine that drew frames failed, or cannot be reached."""

    __notes__: list[str]  # where it failed there; shown with a traceback
