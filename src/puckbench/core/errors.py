"""The one exception a user can cause, printed as one line with exit status 2."""


class InputError(Exception):
    """Something the user gave (file, stream, name, value) cannot be used.

    The message is one line that names the thing and the fault. It is raised where the fault is
    known and printed once, at the edge (command line or workflow), with exit status 2.
    """
