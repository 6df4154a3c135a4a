"""The table at the end of a run: what was seen, what was lost, how far off it is."""

from rich import box
from rich.table import Table
from rich.text import Text

__all__ = ["COLOURS", "accuracy_table", "frames_table", "totals"]

#: A colour per status, in the order of the codes, for pictures and terminals alike.
COLOURS = ("#35d07f", "#b0b0b0", "#ffb02e", "#ff5a4f")

_COUNTED = ("ok", "noise", "ambiguous", "rejected")


def _figures(shown):
    return {
        "spots": shown.spots, **{name: shown.count(name) for name in _COUNTED[:3]},
        "rejected": shown.rejected, "dropped": shown.dropped}


def totals(frames):
    """Sums over frames of spots, ok, noise, ambiguous, rejected and dropped."""
    figures = [_figures(shown) for shown in frames]
    return {name: sum(each[name] for each in figures)
            for name in ("spots", *_COUNTED, "dropped")}


def _cell(name, value):
    bad = value and name in ("dropped",)
    return Text(str(value), style="bold red" if bad else "" if value else "dim")


def frames_table(frames, limit=None):
    """Table of frames and their sums.

    Parameters
    ----------
    frames : list of :class:`scripts.points.Shown`
        In the order measured.
    limit : :class:`int` or None
        With more frames than this, only those with notes have a line of their own, and the first
        ``limit`` of the others.
    """
    table = Table(box=box.SIMPLE_HEAD, title=f"Spots of {len(frames)} frames",
                  title_justify="left", padding=(0, 1), pad_edge=False)
    table.add_column("frame", justify="right", no_wrap=True)
    table.add_column("level", justify="right", no_wrap=True)
    for name, colour in zip(_COUNTED, COLOURS, strict=True):
        if name == "ok":
            table.add_column("spots", justify="right", no_wrap=True)
        table.add_column(name, justify="right", header_style=colour, no_wrap=True)
    table.add_column("dropped", justify="right", no_wrap=True)
    table.add_column("notes")
    hidden = 0
    for position, shown in enumerate(frames):
        if limit is not None and position >= limit and not shown.notes:
            hidden += 1
            continue
        figures = _figures(shown)
        table.add_row(
            str(shown.index), str(shown.level),
            *(_cell(name, value) for name, value in figures.items()),
            Text("; ".join(shown.notes), style="yellow"))
    if hidden:
        table.add_row("…", *[""] * 7, Text(f"{hidden} more", style="dim"))
    table.add_section()
    noted = sum(bool(shown.notes) for shown in frames)
    table.add_row("all", "", *(str(value) for value in totals(frames).values()),
                  Text(f"{noted} noted" if noted else ""), style="bold")
    return table


def _share(value, digits=2):
    return "-" if value != value else f"{100 * value:.{digits}f} %"


def accuracy_table(accuracies):
    """Table of errors against truth.

    Parameters
    ----------
    accuracies : :class:`dict` of :class:`str` to :class:`scripts.accuracy.Accuracy`
        A column each, for instance one for all frames.
    """
    table = Table(box=box.SIMPLE_HEAD, title="Against the truth", title_justify="left",
                  padding=(0, 1), pad_edge=False)
    table.add_column("")
    for name in accuracies:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("meaning", style="dim")
    for name, figure, meaning in (
            ("beams", lambda each: str(each.expected), "inside the picture and the range"),
            ("found", lambda each: _share(each.found), "of these beams have an ok point"),
            ("ok points", lambda each: str(len(each.points)), "all of them, wrong beams included"),
            ("wrong", lambda each: _share(each.wrong), "of the ok points are off by more than 5 %"),
            ("mean error", lambda each: _share(each.mean, 3), "|z - true z| / true z, ok points"),
            ("median error", lambda each: _share(each.median, 3), ""),
            ("worst error", lambda each: _share(each.worst, 3), "")):
        table.add_row(name, *(figure(each) for each in accuracies.values()), meaning)
    return table
