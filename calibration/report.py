"""Tables of a calibration's results, for the terminal."""

from rich import box
from rich.table import Table

from calibration.figures import figures

__all__ = ["beam_remarks", "beams_table", "summary_table"]

#: With more columns of beams their table has no room for the numbers of planes.
_MOST_COLUMNS = 9


def _table(title, padding=1):
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", padding=(0, padding),
                  pad_edge=False)
    table.add_column("")
    return table


def summary_table(result):
    """The main figures of a :class:`calibration.calibrate.Result`, with their good ranges."""
    table = _table("Calibration")
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("good", no_wrap=True)
    table.add_column("meaning", style="dim")
    for figure in figures(result):
        style = "" if figure.good else "[bold red]"
        table.add_row(figure.name, style + figure.value, style + figure.range, figure.meaning)
        if figure.section:
            table.add_section()
    return table


def beams_table(result):
    """RMS distance of each beam's spots from its line, laid out as the mesh."""
    calibration, lines = result.calibration, result.lines
    index = {number: index for index, number in enumerate(lines.numbers.tolist())}
    narrow = calibration.columns > _MOST_COLUMNS
    table = _table("RMS distance of the spots from their line, 1/1000 px"
                   + ("" if narrow else " (planes)"), 0 if narrow else 1)
    for column in range(calibration.columns):
        table.add_column(str(column), justify="right", no_wrap=True)
    usual = float(sorted(lines.residual_v)[len(lines.residual_v) // 2])
    for row in range(calibration.rows):
        cells = []
        for column in range(calibration.columns):
            beam = row * calibration.columns + column
            if beam not in index:
                cells.append(f"[bold red]{'-' if narrow else 'none'}[/bold red]")
                continue
            residual = lines.residual_v[index[beam]]
            style = "bold red" if residual > 4 * usual else "yellow" if residual > 2 * usual else ""
            text = f"{1000 * residual:.0f}"
            if not narrow:
                text += f" [dim]({int(lines.planes[index[beam]])})[/dim]"
            cells.append(f"[{style}]{text}[/{style}]" if style else text)
        table.add_row(str(row), *cells)
    return table


def beam_remarks(result):
    """A sentence for each beam that was left out or is unusual."""
    calibration = result.calibration
    return [f"Beam {beam} (row {beam // calibration.columns}, column "
            f"{beam % calibration.columns}): {text}."
            for beam, text in sorted(calibration.remarks.items())]
