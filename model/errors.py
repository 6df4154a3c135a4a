"""What went wrong, in one sentence for the person at the terminal."""


class UserError(Exception):
    """The run cannot go on; the message is one full sentence: what is wrong, and what to do.

    The command line prints the sentence alone, without a traceback, and exits with a status
    other than 0.
    """
