"""The one exception that users see as a single line instead of a traceback."""


class UserError(ValueError):
    """A mistake in what the user gave (a key, a file, a checkpoint), not in the program.

    The message is one line: it names the file or key and says what to do. ``run.py`` prints it
    without a traceback and exits with status 2.
    """
