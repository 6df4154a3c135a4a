"""Plots of a calibration: spots, epipolar lines and residuals."""

import numpy as np

from calibration.files import beside

__all__ = ["draw", "write"]


def _beam_colours(count):
    """A colour per beam; those of neighbouring beams are far apart."""
    from matplotlib import colormaps
    return colormaps["turbo"]((np.arange(count) * 0.381966 % 1) * 0.9 + 0.05)


def _draw_lines(axes, result):
    """Spots of all planes in the image, each beam's line over its window, the usable region."""
    from matplotlib.patches import Circle
    calibration, lines, windows = result.calibration, result.lines, result.windows
    lens, colours = calibration.lens, _beam_colours(calibration.projector.beams)
    for beam, colour in enumerate(colours[lines.numbers]):
        u = np.linspace(windows.low[beam], windows.high[beam], 40)
        image = lens.distort(u, lines.a[beam] * u + lines.b[beam])
        axes.plot(*image, color=colour, linewidth=0.9, zorder=1)
        far = min(0, 39, key=lambda end: lines.alpha[beam] * u[end])
        axes.annotate(str(lines.numbers[beam]), (image[0][far], image[1][far]), fontsize=6,
                      color="0.35", ha="right" if lines.alpha[beam] > 0 else "left", va="center",
                      xytext=(-2 if lines.alpha[beam] > 0 else 2, 0),
                      textcoords="offset points")
    if lens.usable_px is not None:
        axes.add_patch(Circle((lens.principal_u, lens.principal_v), lens.usable_px, fill=False,
                              edgecolor="0.6", linestyle="--", linewidth=0.8, zorder=0))
    stray = 0
    for plane, beams in zip(result.planes, result.identity.beams, strict=True):
        own = beams >= 0
        axes.scatter(plane.u[own], plane.v[own], s=7, c=colours[beams[own]], linewidths=0.3,
                     edgecolors="black", zorder=2)
        axes.scatter(plane.u[~own], plane.v[~own], s=14, c="red", marker="x", linewidths=0.8,
                     zorder=3)
        stray += int((~own).sum())
    axes.set(xlim=(-0.5, calibration.width - 0.5), ylim=(calibration.height - 0.5, -0.5),
             aspect="equal", xlabel="u, px", ylabel="v, px",
             title=f"Spots of {len(result.planes)} planes, and each beam's line over its window\n"
                   f"{stray} spots without a beam (red crosses)")


def _residuals(result):
    """Undistorted positions of all spots, and their errors along u and along v, px."""
    lens, lines, data = result.calibration.lens, result.lines, result.observations
    position = data.x + lens.principal_x, data.y + lens.principal_y
    error_u = position[0] - (data.inverse_z - lines.beta[data.beam]) / lines.alpha[data.beam]
    error_v = position[1] - lines.a[data.beam] * position[0] - lines.b[data.beam]
    return position, error_u, error_v


def _draw_residuals(axes, result):
    """Residuals of all spots as arrows in the image."""
    calibration, lines, data = result.calibration, result.lines, result.observations
    position, error_u, error_v = _residuals(result)
    image = calibration.lens.distort(*position)
    scale = max(4 * lines.sigma_u, 4 * lines.sigma_v, 1e-3)
    arrows = axes.quiver(*image, error_u, error_v, data.inverse_z, angles="xy", width=0.0022,
                         scale_units="xy", scale=scale / 12, cmap="viridis")
    axes.quiverkey(arrows, 0.95, 1.025, scale, f"{scale:.2f} px", labelpos="W")
    axes.figure.colorbar(arrows, ax=axes, label="1/z, 1/mm", shrink=0.7,
                         location="bottom", pad=0.01, aspect=50)
    axes.set(xlim=(-0.5, calibration.width - 0.5), ylim=(calibration.height - 0.5, -0.5),
             aspect="equal")
    axes.set_title("Residuals: along u from the depth law, along v from the line", loc="left")


def _draw_mesh(axes, result):
    """RMS distance from the line of every beam, laid out as the mesh."""
    calibration, lines = result.calibration, result.lines
    residual = np.full(calibration.rows * calibration.columns, np.nan)
    residual[lines.numbers] = lines.residual_v
    residual = residual.reshape(calibration.rows, calibration.columns)
    picture = axes.imshow(residual, cmap="magma", vmin=0)
    if residual.size > 100:
        axes.figure.colorbar(picture, ax=axes, label="px RMS", shrink=0.8)
    else:
        for (row, column), value in np.ndenumerate(residual):
            text = "none" if np.isnan(value) else f"{1000 * value:.0f}"
            axes.text(column, row, text, ha="center", va="center", fontsize=7,
                      color="white" if value < 0.6 * lines.residual_v.max() else "black")
    axes.set(xlabel="column", ylabel="row",
             title="RMS distance from the line, beam by beam"
                   + (", 1/1000 px" if residual.size <= 100 else ""))


def _draw_depth(axes, result):
    """Relative residuals of 1/z over the distance of the planes."""
    lines, data = result.lines, result.observations
    _, error_u, _ = _residuals(result)
    relative = 100 * error_u * lines.alpha[data.beam] / data.inverse_z
    axes.scatter(1 / data.inverse_z, relative, s=5, c="0.6", linewidths=0)
    for z in np.unique(1 / data.inverse_z):
        values = relative[1 / data.inverse_z == z]
        axes.errorbar(z, np.mean(values), np.std(values), fmt="o", color="tab:blue", markersize=4,
                      linewidth=1, capsize=2)
    reach = 5 * np.median(np.abs(relative)) + 1e-6
    axes.set(ylim=(-reach, reach), xlabel="z, mm", ylabel="depth residual, %",
             title="1/z of the plane frames")
    axes.axhline(0, color="0.4", linewidth=0.6)


def draw(result):
    """A matplotlib figure: lines with spots, residuals, the mesh, and depth errors by plane.

    Parameters
    ----------
    result : :class:`calibration.calibrate.Result`
        All that the calibration found.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    calibration, lines = result.calibration, result.lines
    figure = Figure(figsize=(16, 11.2), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.7, 1))
    _draw_lines(figure.add_subplot(grid[0, 0]), result)
    _draw_residuals(figure.add_subplot(grid[0, 1]), result)
    _draw_mesh(figure.add_subplot(grid[1, 0]), result)
    _draw_depth(figure.add_subplot(grid[1, 1]), result)
    figure.suptitle(
        f"{calibration.rows} x {calibration.columns} beams, lens {result.lens_report.rms_px:.3f} "
        f"px RMS, lines {lines.rms_px:.3f} px RMS, smallest line separation "
        f"{result.windows.smallest_px:.2f} px")
    return figure


def write(result, path):
    """Draw into a PNG file."""
    with beside(path) as file:
        draw(result).savefig(file, format="png")
