"""How the command is called from here, for commands in messages that can be pasted."""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path

__all__ = ["pasteable", "program"]


def program():
    """The word that calls ``cyclope`` again from the current folder.

    ``cyclope`` where the shell finds this one, else its path, as short as can be and quoted for
    the shell.
    """
    script = Path(sys.argv[0])
    if script.name != "cyclope":  # called from Python, by the demo for instance
        script = Path(sys.executable).with_name("cyclope")
    found = shutil.which("cyclope")
    if not script.is_file() or found and os.path.samefile(found, script):
        return "cyclope"
    path = Path(os.path.abspath(script))
    if path.is_relative_to(Path.cwd()):
        path = path.relative_to(Path.cwd())
    return shlex.quote(str(path) if len(path.parts) > 1 else f"./{path}")


def pasteable(text):
    """``text`` with every ```cyclope ...``` in it as it has to be typed here."""
    return re.sub("`cyclope(?=[ `])", lambda _: f"`{program()}", text)
