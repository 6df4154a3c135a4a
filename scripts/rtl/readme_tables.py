"""Writes the tables of ``hdl/link/README.md`` and ``hdl/README.md`` from the RTL's sources.

Between the lines ``<!-- protocol: NAME -->`` and ``<!-- end -->`` stands a table of
``hdl/protocol.py``. Between ``<!-- blocks: PRESET -->`` and ``<!-- end -->`` a table names a block
in the first cell of each row; its columns *Latency* and *Memory* have the block's attribute
``latency`` and its memories, at the sizes of that preset. With ``--check`` nothing is written, and
the exit status is 1 if a table is stale.
"""

import argparse
import inspect
import re
import sys
from collections import Counter

from amaranth.hdl import Fragment, MemoryInstance, Shape

from hdl import protocol
from hdl.config import PRESETS
from scripts.paths import ROOT
from scripts.rtl.blocks import find

__all__ = ["FILES", "TABLES", "columns", "main", "meanings", "updated"]

#: Files with tables.
FILES = ("hdl/link/README.md", "hdl/README.md")
#: What the code's names are called where they are read.
_WORDS = {
    "IDENTITY_FIELDS": "[identity](#identity-and-status)",
    "STATUS_FIELDS": "[status](#identity-and-status)",
    "TEXTURE_FIELDS": "the table in [texture](#texture)",
    "TABLE_VERSION": "version of the tables",
    "see GUARD_CAUSES": "see [causes](#identity-and-status)",
    "see DISPLAY_FAULTS": "see [below](#identity-and-status)",
    "see Texture": "see [texture](#texture)",
    "see Flag": "as in [points](#points)",
}
_MARKED = re.compile(r"(<!-- protocol: (\w+) -->\n).*?(<!-- end -->)", re.S)
_OF_BLOCKS = re.compile(r"(<!-- blocks: (\w+) -->\n)(.*?)(<!-- end -->)", re.S)
#: How a docstring says what its attribute ``latency`` is.
_DOCUMENTED = re.compile(r"^latency : :class:`int`\n((?:    .+\n?)+)", re.M)


def meanings(enumeration):
    """The comment behind each member of an enumeration, by the member's name."""
    found = re.findall(r"^    (\w+) = \w+(?:  # (.*))?$", inspect.getsource(enumeration), re.M)
    return {name: meaning for name, meaning in found if name in enumeration.__members__}


def _rows(heads, rows):
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    text = "\n".join(lines) + "\n"
    for name, words in _WORDS.items():
        text = text.replace(name, words)
    return text


def _members(enumeration, head, code="{:d}"):
    """A table of an enumeration's members."""
    found = meanings(enumeration)
    return _rows((head, "Name", "Meaning"), (
        (code.format(member), f"`{name}`", found[name])
        for name, member in enumeration.__members__.items()))


def _fields(fields):
    """A table of the fields of a packet, by octet."""
    rows, at = [], 0
    for field in fields:
        octets = field.bits // 8
        place = at if octets == 1 else f"{at} to {at + octets - 1}"
        rows.append((place, f"`{field.name}`", field.meaning))
        at += octets
    return _rows(("Octets", "Field", "Meaning"), rows)


def _packets():
    found = meanings(protocol.PacketKind)
    return _rows(("Kind", "Name", "Body"), (
        (f"`{kind:02X}`", f"`{kind.name}`", found[kind.name]) for kind in protocol.PacketKind))


def _trailer():
    return _fields(protocol.TRAILER_FIELDS)


def _compact():
    form = protocol.COMPACT
    return _rows(("Bits", "Short form", "Bits", "Long form"), (
        (1, "0", 1, "1"),
        (form.V_BITS, f"v less the v of the point before in the packet (0 for the first), plus "
                      f"{form.V_OFFSET}", 18, "v"),
        (18, "u", 18, "u"),
        (form.AREA_BITS, "area", 9, "the area's code"),
        ("", "", 2, "`saturated`, `border`"),
        (form.SHORT_BITS, "together", form.LONG_BITS, "together")))


def _commands():
    found = meanings(protocol.Command)
    return _rows(("Code", "Command", "Parameters and reply, bits in parentheses"), (
        (f"`{command:02X}`", f"`{command.name}`", found[command.name])
        for command in protocol.Command))


def _reasons():
    return _members(protocol.Reason, "Reason")


def _flags():
    return _members(protocol.Flag, "Bit")


def _registers():
    rows = []
    for register in protocol.registers():
        low, high = register.low, register.high
        if register.signed:
            low, high = -(1 << register.bits - 1), (1 << register.bits - 1) - 1
        elif high is None:
            high = (1 << register.bits) - 1
        meaning = register.meaning + ("; only while stopped" if register.only_stopped else "")
        rows.append((f"`{register.address:02X}`", f"`{register.name}`", register.bits,
                     f"{low} to {high}", register.reset, meaning))
    return _rows(("Address", "Name", "Bits", "Values", "Reset", "Meaning"), rows)


def _tables():
    words = {"depth": "2 K", "beams": "K", "remap": "pixels / 4"}
    return _rows(("Number", "Name", "Words", "Bits", "Octets", "A word"), (
        (table.number, f"`{table.name}`", words.get(table.name, table.words), table.bits,
         table.octets, "; ".join(field.meaning for field in table.fields))
        for table in protocol.tables("paper")))


def _bits(name, head):
    """A table of the bits that a tuple of names stands for."""
    found = re.search(rf"^{name} = \((.*?)\n\)", inspect.getsource(protocol), re.M | re.S)[1]
    rows = re.findall(r'"(\w+)",  # (.*)', found)
    assert tuple(each for each, _ in rows) == getattr(protocol, name)
    return _rows(("Bit", head, "Meaning"), (
        (bit, f"`{each}`", meaning) for bit, (each, meaning) in enumerate(rows)))


def _causes():
    return _bits("GUARD_CAUSES", "Cause")


def _display():
    return _bits("DISPLAY_FAULTS", "Fault")


def _texture():
    return _fields(protocol.TEXTURE_FIELDS)


def _identity():
    return _fields(protocol.IDENTITY_FIELDS)


def _status():
    return _fields(protocol.STATUS_FIELDS)


#: What writes each table, by its name.
TABLES = {function.__name__[1:]: function for function in (
    _packets, _trailer, _compact, _texture, _flags, _commands, _reasons, _registers, _tables,
    _identity, _status, _causes, _display)}


def columns(name, preset):
    """Latency and memories of a block, by the head of their columns.

    Returns
    -------
    :class:`dict`
        ``Latency`` in clocks, such as ``3`` or ``832 at most``; ``Memory`` in words and bits, such
        as ``2 x 128 x 36, 16 x 11``.

    Raises
    ------
    LookupError
        If there is no such block, or its docstring does not say from what to what its latency
        is.
    """
    block = find(name)
    documented = _DOCUMENTED.search(inspect.getdoc(block.component_class))
    if documented is None:
        raise LookupError(f"The docstring of {name} has no attribute `latency`")
    component = block.component(PRESETS[preset])
    sizes = Counter(_memories(Fragment.get(component, None)))
    return {
        "Latency": f"{component.latency:,}" + (
            " at most" if re.search(r"at\s+most", documented[1]) else ""),
        "Memory": ", ".join(
            size if count == 1 else f"{count} x {size}" for size, count in sizes.items())}


def _memories(fragment):
    if isinstance(fragment, MemoryInstance):
        words = fragment._data
        yield f"{words.depth} x {Shape.cast(words.shape).width}"
        return
    for inner, *_ in fragment.subfragments:
        yield from _memories(inner)


def _cells(line):
    return [cell.strip() for cell in line.split("|")[1:-1]]


def _of_blocks(table, preset):
    """A table of blocks with the cells of its columns *Latency* and *Memory* written anew."""
    lines = table.splitlines()
    heads = _cells(lines[0])
    for number, line in enumerate(lines[2:], 2):
        cells = _cells(line)
        for head, contents in columns(cells[0].strip("`"), preset).items():
            cells[heads.index(head)] = contents
        lines[number] = "|".join(["", *(f" {cell} " if cell else " " for cell in cells), ""])
    return "\n".join(lines) + "\n"


def updated(text):
    """``text`` with all its tables written anew."""
    text = _MARKED.sub(lambda found: found[1] + TABLES[found[2]]() + found[3], text)
    return _OF_BLOCKS.sub(
        lambda found: found[1] + _of_blocks(found[3], found[2]) + found[4], text)


def main(arguments=None):
    """Write the tables, or with ``--check`` only look; gives the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m scripts.rtl.readme_tables", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, fail if stale")
    check = parser.parse_args(arguments).check
    stale = []
    for name in FILES:
        path = ROOT / name
        text = path.read_text()
        new = updated(text)
        if new != text:
            stale.append(name)
            if not check:
                path.write_text(new)
    if check and stale:
        print(f"Tables are stale in {' and '.join(stale)}: "
              "run `python -m scripts.rtl.readme_tables`.")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
