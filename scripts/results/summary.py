"""Tables for the end of a run: spots of frames, notes, and errors against the truth."""

from rich import box
from rich.table import Table
from rich.text import Text

__all__ = ["COLOURS", "accuracy_table", "frames_table", "notes_text", "plural", "totals"]

#: A colour per status, in the order of the codes, for overlays and terminals.
COLOURS = ("#35d07f", "#b0b0b0", "#ffb02e", "#ff5a4f", "#c58cff", "#ff7ad9")

_COUNTED = ("ok", "noise", "ambiguous", "rejected", "duplicate", "doubtful")
#: Columns that are there only if there is something in them, and their short names.
_SELDOM = {"duplicate": "dup", "doubtful": "doubt"}


def plural(number, what):
    """``1 frame`` or ``3 frames``."""
    return f"{number} {what}{'s' * (number != 1)}"


def _figures(frame):
    return {
        "spots": frame.spots, **{name: frame.count(name) for name in _COUNTED[:3]},
        "rejected": frame.rejected, **{name: frame.count(name) for name in _SELDOM},
        "dropped": frame.dropped}


def totals(frames):
    """Sums over frames: spots, of each status, and dropped."""
    figures = [_figures(frame) for frame in frames]
    return {name: sum(each[name] for each in figures)
            for name in ("spots", *_COUNTED, "dropped")}


def _cell(name, value):
    bad = value and name == "dropped"
    return Text(str(value), style="bold red" if bad else "" if value else "dim")


def frames_table(frames, limit=None):
    """Table of frames and their sums.

    Parameters
    ----------
    frames : list of :class:`scripts.results.points.FrameResult`
        In the order measured.
    limit : :class:`int` or None
        Number of frames listed first; of the others only those with notes are, at most as many.

    The columns `dup` and `doubt`, of duplicate and doubtful ones, are there if there are any.
    """
    sums = totals(frames)
    hidden = [name for name in _SELDOM if not sums[name]]
    columns = [(_SELDOM.get(name, name), colour)
               for name, colour in zip(_COUNTED, COLOURS, strict=True) if name not in hidden]
    table = Table(box=box.SIMPLE_HEAD, title=f"Spots of {plural(len(frames), 'frame')}",
                  title_justify="left", padding=(0, 1), pad_edge=False)
    for name, colour in (("frame", ""), ("level", ""), ("spots", ""),
                         *columns, ("dropped", ""), ("", "")):
        table.add_column(name, justify="right", header_style=colour, no_wrap=True)
    lines = left_out = 0
    for position, frame in enumerate(frames):
        late = limit is not None and position >= limit
        if late and (not frame.notes or lines >= 2 * limit):
            left_out += 1
            continue
        lines += 1
        table.add_row(
            str(frame.index), f"{frame.level:.1f}",
            *(_cell(name, value) for name, value in _figures(frame).items()
              if name not in hidden),
            Text("!" if frame.notes else "", style="bold yellow"))
    if left_out:
        table.add_row("…", f"{left_out} more")
    table.add_section()
    table.add_row("all", "", *(str(value) for name, value in sums.items()
                               if name not in hidden), style="bold")
    return table


def notes_text(frames, limit=None):
    """Notes of frames, a line per frame; at most ``limit`` lines, then the number left out."""
    noted = [frame for frame in frames if frame.notes]
    lines = [f"! frame {frame.index}: {'; '.join(frame.notes)}" for frame in noted[:limit]]
    if len(lines) < len(noted):
        more = plural(len(noted) - len(lines), "more frame")
        lines.append(f"! {more} with notes, in summary.txt")
    return Text("\n".join(lines), style="yellow")


def _share(value, digits=2):
    return "-" if value != value else f"{100 * value:.{digits}f} %"


def accuracy_table(accuracies):
    """Table of errors against truth.

    Parameters
    ----------
    accuracies : :class:`dict` of :class:`str` to :class:`scripts.results.accuracy.Accuracy`
        A column for each.
    """
    table = Table(box=box.SIMPLE_HEAD, title="Against the truth", title_justify="left",
                  padding=(0, 1), pad_edge=False)
    table.add_column("")
    for name in accuracies:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("meaning", style="dim")
    for name, figure, meaning in (
            ("beams", lambda each: str(each.expected), "inside the image and the depth range"),
            ("found", lambda each: _share(each.found), "of these beams have an ok point"),
            ("ok points", lambda each: str(len(each.points)), "all of them, wrong beams included"),
            ("wrong", lambda each: _share(each.wrong), "of the ok points are off by more than 5 %"),
            ("mean error", lambda each: _share(each.mean, 3), "|z - true z| / true z, ok points"),
            ("median error", lambda each: _share(each.median, 3), ""),
            ("worst error", lambda each: _share(each.worst, 3), "")):
        table.add_row(name, *(figure(each) for each in accuracies.values()), meaning)
    return table
