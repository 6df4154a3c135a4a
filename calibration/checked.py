"""Values of a JSON file that may be forged: taken by name, each of its type and within limits."""

import json
import math

__all__ = ["InvalidError", "Section", "parse_json"]


class InvalidError(ValueError):
    """What is wrong with the content, in words for the middle of a sentence."""


def _object(pairs):
    content = dict(pairs)
    if len(content) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidError(f"it has {twice[:40]!r} twice")
    return content


def _no_number(text):
    raise InvalidError(f"{text} is no number")


def parse_json(data):
    """The object in a JSON text.

    Raises :class:`InvalidError` for anything else, for a key that stands there twice, for numbers
    that are none, and for more levels than Python reads.
    """
    try:
        content = json.loads(data, object_pairs_hook=_object, parse_constant=_no_number)
    except InvalidError:
        raise
    except RecursionError:
        raise InvalidError("it is nested too deeply") from None
    except ValueError as error:
        raise InvalidError(f"it is not valid JSON: {str(error)[:80]}") from error
    if not isinstance(content, dict):
        raise InvalidError("it is no JSON object")
    return content


class Section:
    """An object of the file whose keys are known; takes values out of it, or says what is wrong.

    Parameters
    ----------
    name : :class:`str`
        What to call it.
    content : object
        What stands there.
    keys : sequence of :class:`str`
        Every key that it must have, and no others.
    """

    def __init__(self, name, content, keys):
        if not isinstance(content, dict):
            raise InvalidError(f"{name} must be an object")
        for key in keys:
            if key not in content:
                raise InvalidError(f"{name} lacks {key}")
        unknown = next((key for key in content if key not in keys), None)
        if unknown is not None:
            raise InvalidError(f"{name} has {unknown[:40]!r}, which nobody knows")
        self._name, self._content = name, content

    def refuse(self, key, must):
        """Raise :class:`InvalidError` on the value of a key."""
        raise InvalidError(f"{key} of {self._name} must be {must}")

    def value(self, key):
        """Whatever stands there."""
        return self._content[key]

    def number(self, key, low, high):
        """A float from ``low`` to ``high``."""
        return self._number(key, self._content[key], low, high)

    def _number(self, key, value, low, high):
        if type(value) not in (int, float) or not low <= value <= high:
            self.refuse(key, f"a number from {low:g} to {high:g}")
        return float(value)

    def numbers(self, key, count, low, high):
        """A tuple of so many floats."""
        value = self._content[key]
        if not isinstance(value, list) or len(value) != count:
            self.refuse(key, f"a list of {count} numbers")
        return tuple(self._number(key, part, low, high) for part in value)

    def integer(self, key, low, high):
        """An integer from ``low`` to ``high``."""
        value = self._content[key]
        if type(value) is not int or not low <= value <= high:
            self.refuse(key, f"an integer from {low} to {high}")
        return value

    def words(self, key, count, bits):
        """A tuple of so many unsigned integers of so many bits."""
        value = self._content[key]
        if not isinstance(value, list) or len(value) != count or not all(
                type(word) is int and 0 <= word < 1 << bits for word in value):
            self.refuse(key, f"a list of {count} words of {bits} bits")
        return tuple(value)

    def flag(self, key):
        """True or False."""
        value = self._content[key]
        if type(value) is not bool:
            self.refuse(key, "true or false")
        return value

    def choice(self, key, choices):
        """One of some texts."""
        value = self._content[key]
        if value not in choices:
            self.refuse(key, f"one of {', '.join(choices)}")
        return value

    def text(self, key, most):
        """A text of so many characters at the most."""
        value = self._content[key]
        if not isinstance(value, str) or len(value) > most:
            self.refuse(key, f"a text of up to {most} characters")
        return value

    def figures(self):
        """All values, which must be finite numbers, or null for one that could not be had."""
        for key, value in self._content.items():
            if value is not None and (
                    type(value) not in (int, float) or not abs(value) < math.inf):
                self.refuse(key, "a number or null")
        return dict(self._content)
