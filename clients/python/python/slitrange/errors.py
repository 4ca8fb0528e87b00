"""Why something did not work. Each message says what happened and what to do."""


class SlitrangeError(Exception):
    """The sensor cannot be used, or did not do what it was asked for."""


class WrongUse(SlitrangeError, ValueError, TypeError):  # noqa: N818 It says what is wrong.
    """An argument cannot be used, or a method cannot be called now. It is one of Python's own errors, too."""


class PortError(SlitrangeError):
    """The port cannot be opened, or stopped working."""


class NoAnswer(SlitrangeError):  # noqa: N818 It says what happened, as the others do.
    """No answer came, or no reading."""


class Refused(SlitrangeError):  # noqa: N818
    """The sensor answered with an error, and has changed nothing.

    Attributes:
        sentence: The answer, as in `E3 out of range, expected rows 1..64`.
        number: The number of the error, 3 in this example.
    """

    def __init__(self, command: str, sentence: str, advice: str = "") -> None:
        """Takes the command, the answer, and what to do about it in Python."""
        super().__init__(f"the sensor answers `{command}` with `{sentence}`{advice and ': '}{advice}")
        self.sentence = sentence
        self.number = int(sentence.split(" ", 1)[0][1:])


class Restarted(SlitrangeError):  # noqa: N818
    """The sensor started anew, and has only the settings that its flash holds."""
