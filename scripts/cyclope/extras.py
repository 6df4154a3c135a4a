"""What an installed package may lack: the packages of its extras."""

from importlib import metadata

from model.errors import UserError

__all__ = ["require"]


def require(extra, purpose, otherwise=""):
    """Refuse if a package of an extra is not installed.

    Parameters
    ----------
    extra : :class:`str`
        One of the extras in ``pyproject.toml``.
    purpose : :class:`str`
        What needs it, the subject of the sentence.
    otherwise : :class:`str`
        What else the user can do, the end of the sentence.

    Raises
    ------
    UserError
        With the command that installs the extra.
    """
    from packaging.requirements import Requirement

    for text in metadata.requires("cyclope") or ():
        requirement = Requirement(text)
        marker = requirement.marker
        if marker is None or marker.evaluate({"extra": ""}) or not marker.evaluate(
                {"extra": extra}):
            continue
        try:
            metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            raise UserError(f"{purpose} needs the extra \"{extra}\": pip install "
                            f"'cyclope[{extra}]'{otherwise}.") from None
