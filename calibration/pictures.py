"""The calibration as a picture: spots, lines and what is left between them."""

import numpy as np

from calibration.file import beside

__all__ = ["draw", "write"]


def _beam_colours(count):
    """Neighbouring beams get colours far apart."""
    from matplotlib import colormaps
    return colormaps["turbo"]((np.arange(count) * 0.381966 % 1) * 0.9 + 0.05)


def draw(result):
    """A matplotlib figure: spots of all planes with lines over their windows, residuals, planes.

    Parameters
    ----------
    result : :class:`calibration.calibrate.Result`
        All that the calibration found.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    calibration, lines, windows = result.calibration, result.lines, result.windows
    lens, data = calibration.lens, result.observations
    figure = Figure(figsize=(16, 11.2), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.7, 1))
    colours = _beam_colours(calibration.projector.beams)

    scene = figure.add_subplot(grid[0, 0])
    for beam, colour in enumerate(colours):
        u = np.linspace(windows.low[beam], windows.high[beam], 40)
        image = lens.distort(u, lines.a[beam] * u + lines.b[beam])
        scene.plot(*image, color=colour, linewidth=0.9, zorder=1)
        far = min(0, 39, key=lambda end: lines.alpha[beam] * u[end])
        scene.annotate(str(beam), (image[0][far], image[1][far]), fontsize=6, color="0.35",
                       ha="right" if lines.alpha[beam] > 0 else "left", va="center",
                       xytext=(-2 if lines.alpha[beam] > 0 else 2, 0),
                       textcoords="offset points")
    stray = 0
    for plane, beams in zip(result.planes, result.identity.beams, strict=True):
        own = beams >= 0
        scene.scatter(plane.u[own], plane.v[own], s=7, c=colours[beams[own]], linewidths=0.3,
                      edgecolors="black", zorder=2)
        scene.scatter(plane.u[~own], plane.v[~own], s=14, c="red", marker="x", linewidths=0.8,
                      zorder=3)
        stray += int((~own).sum())
    scene.set(xlim=(-0.5, calibration.width - 0.5), ylim=(calibration.height - 0.5, -0.5),
              aspect="equal", xlabel="u, px", ylabel="v, px",
              title=f"Spots of {len(result.planes)} planes, and each beam's line over its window\n"
                    f"{stray} spots without a beam (red crosses)")

    where = data.x + lens.principal_x, data.y + lens.principal_y
    error_u = where[0] - (data.inverse_z - lines.beta[data.beam]) / lines.alpha[data.beam]
    error_v = where[1] - lines.a[data.beam] * where[0] - lines.b[data.beam]
    field = figure.add_subplot(grid[0, 1])
    image = lens.distort(*where)
    scale = max(4 * lines.sigma_u, 4 * lines.sigma_v, 1e-3)
    arrows = field.quiver(*image, error_u, error_v, data.inverse_z, angles="xy", width=0.0022,
                          scale_units="xy", scale=scale / 12, cmap="viridis")
    field.quiverkey(arrows, 0.95, 1.025, scale, f"{scale:.2f} px", labelpos="W")
    figure.colorbar(arrows, ax=field, label="1/z, 1/mm", shrink=0.7,
                    location="bottom", pad=0.01, aspect=50)
    field.set(xlim=(-0.5, calibration.width - 0.5), ylim=(calibration.height - 0.5, -0.5),
              aspect="equal")
    field.set_title("What is left: along u from the depth law, along v from the line", loc="left")

    mesh = figure.add_subplot(grid[1, 0])
    residual = lines.residual_v.reshape(calibration.rows, calibration.columns)
    shown = mesh.imshow(residual, cmap="magma", vmin=0)
    if residual.size > 100:
        figure.colorbar(shown, ax=mesh, label="px RMS", shrink=0.8)
    else:
        for (row, column), value in np.ndenumerate(residual):
            mesh.text(column, row, f"{1000 * value:.0f}", ha="center", va="center", fontsize=7,
                      color="white" if value < 0.6 * residual.max() else "black")
    mesh.set(xlabel="column", ylabel="row",
             title="RMS distance from the line, beam by beam"
                   + (", 1/1000 px" if residual.size <= 100 else ""))

    depth = figure.add_subplot(grid[1, 1])
    relative = 100 * error_u * lines.alpha[data.beam] / data.inverse_z
    depth.scatter(1 / data.inverse_z, relative, s=5, c="0.6", linewidths=0)
    for z in np.unique(1 / data.inverse_z):
        values = relative[1 / data.inverse_z == z]
        depth.errorbar(z, np.mean(values), np.std(values), fmt="o", color="tab:blue", markersize=4,
                       linewidth=1, capsize=2)
    reach = 5 * np.median(np.abs(relative)) + 1e-6
    depth.set(ylim=(-reach, reach), xlabel="z, mm", ylabel="depth residual, %",
              title="1/z of the plane frames")
    depth.axhline(0, color="0.4", linewidth=0.6)
    figure.suptitle(
        f"{calibration.rows} x {calibration.columns} beams, lens {result.lens_report.rms_px:.3f} "
        f"px RMS, lines {lines.rms_px:.3f} px RMS, smallest line separation "
        f"{windows.smallest_px:.2f} px")
    return figure


def write(result, path):
    """Draw into a PNG file."""
    with beside(path) as file:
        draw(result).savefig(file, format="png")
