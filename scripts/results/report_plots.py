"""Plots over all frames: the point cloud from two sides, and the depth error against truth."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as pyplot  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.colors import Normalize  # noqa: E402
from matplotlib.ticker import MaxNLocator  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Line3DCollection  # noqa: E402

from scripts.results.accuracy import WRONG  # noqa: E402
from scripts.results.summary import plural  # noqa: E402

__all__ = ["plot_cloud", "plot_error"]

_MAP = "viridis_r"


def _mesh(axes, points, columns):
    """Join neighbouring beams of one frame, to show the surface."""
    by_beam = {int(point["beam"]): [point[name] for name in "xzy"] for point in points}
    ends = [(position, by_beam[other]) for beam, position in by_beam.items()
            for other in ([beam + 1] if beam % columns < columns - 1 else []) + [beam + columns]
            if other in by_beam]
    if ends:
        axes.add_collection3d(Line3DCollection(ends, colors="0.55", linewidths=0.7, zorder=1))


def _view(figure, cell, title, points, columns, elevation, azimuth, hidden, colours=None):
    """One view of some points; the axes in ``hidden`` have no numbers."""
    axes = figure.add_subplot(cell, projection="3d", computed_zorder=False)
    if len(np.unique(points["frame"])) == 1:
        _mesh(axes, points, columns)
    scatter = axes.scatter(
        points["x"], points["z"], points["y"], c=points["z"], cmap=_MAP, norm=colours,
        s=np.clip(6000 / len(points), 3, 24), depthshade=False, zorder=2)
    # A flat scene viewed from the side still needs room for its tick labels.
    middle = [(points[name].min() + points[name].max()) / 2 for name in "xzy"]
    span = [np.ptp(points[name]) for name in "xzy"]
    half = [0.55 * max(each, 0.3 * max(span), 1) for each in span]
    axes.set(xlim=(middle[0] - half[0], middle[0] + half[0]),
             ylim=(middle[1] - half[1], middle[1] + half[1]),
             zlim=(middle[2] + half[2], middle[2] - half[2]))
    axes.set_title(title, y=0.98)
    axes.set(xlabel="x, right", ylabel="z, away", zlabel="y, down")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    for axis in hidden:
        getattr(axes, axis + "axis").set_ticklabels([])
        getattr(axes, axis + "axis").labelpad = -8
    axes.view_init(elevation, azimuth)
    axes.set_aspect("equal")
    return scatter


def plot_cloud(path, points, columns):
    """Scatter of all points with coordinates from two sides, and of single frames.

    Parameters
    ----------
    path : path
        PNG to write.
    points : array of :data:`scripts.results.points.POINT`
        All spots.
    columns : :class:`int`
        Of the laser mesh; neighbouring beams of a frame are joined.
    """
    located = points[np.isfinite(points["z"])]
    frames = np.unique(located["frame"])
    single = len(frames) <= 1
    figure = pyplot.figure(figsize=(12, 6 if single else 9.5), layout="constrained")
    figure.suptitle(f"{plural(len(located), 'point')} of {plural(len(frames), 'frame')}, "
                    "in millimetres, coloured by their distance")
    if not len(located):
        figure.text(0.5, 0.5, "no points", ha="center", fontsize=20, color="0.5")
        figure.savefig(path, dpi=100)
        pyplot.close(figure)
        return
    colours = Normalize(located["z"].min(), located["z"].max())
    few = frames[np.linspace(0, len(frames) - 1, min(len(frames), 4)).round().astype(int)]
    grid = figure.add_gridspec(1 if single else 2, 12, height_ratios=[1] if single else [3, 2])
    what = f"frame {frames[0]}" if single else "all frames"
    _view(figure, grid[0, :6], f"{what}, from the camera", located, columns, 10, -80, "y",
          colours)
    scatter = _view(figure, grid[0, 6:], f"{what}, from the side", located, columns, 8, -8, "x",
                    colours)
    figure.colorbar(scatter, ax=figure.axes, label="distance z, mm", shrink=0.7, pad=0.03)
    for number, frame in enumerate([] if single else few):
        mine = located[located["frame"] == frame]
        step = 12 // len(few)
        near, far = mine["z"].min(), mine["z"].max()
        _view(figure, grid[1, number * step:(number + 1) * step],
              f"frame {frame}, obliquely\nz {near:.1f} (yellow) to {far:.1f}", mine, columns, 18,
              -35, "xy")
    figure.savefig(path, dpi=100)
    pyplot.close(figure)


def plot_error(path, accuracy, width, height):
    """Error of every ok point over its depth, and the mean error of every beam in the image.

    Parameters
    ----------
    path : path
        PNG to write.
    accuracy : :class:`scripts.results.accuracy.Accuracy`
        Points and errors.
    width, height : :class:`int`
        The image.
    """
    points, error = accuracy.points, 100 * accuracy.error
    size = np.abs(error)
    right = size <= 100 * WRONG
    figure, (left, map_axes) = pyplot.subplots(1, 2, figsize=(13, 5.4), layout="constrained")
    figure.suptitle(
        f"Depth error against the truth: mean {100 * accuracy.mean:.3f} %, "
        f"median {100 * accuracy.median:.3f} %, found {100 * accuracy.found:.1f} %, "
        f"wrong {100 * accuracy.wrong:.2f} %")
    left.axhline(0, color="0.6", linewidth=0.8)
    left.scatter(points["z"][right], error[right], s=9, alpha=0.6, linewidths=0,
                 label=f"{np.count_nonzero(right)} ok points within {100 * WRONG:.0f} %")
    limit = max(1.3 * np.nanmax(size[right], initial=0.05), 0.05)
    wrong = ~right & np.isfinite(size)
    if wrong.any():
        left.scatter(points["z"][wrong], np.clip(error[wrong], -limit, limit), marker="x", s=40,
                     color="crimson", zorder=3,
                     label=f"{np.count_nonzero(wrong)} wrong (off by more, "
                           "drawn at the edge)")
    left.set(xlabel="measured distance z, mm", ylabel="error (z - true z) / true z, %",
             ylim=(-1.05 * limit, 1.05 * limit), title="every point")
    left.legend(loc="upper left")
    left.grid(alpha=0.3)

    beams = np.unique(points["beam"][right])
    of_beam = [right & (points["beam"] == beam) for beam in beams]
    position = [[points[name][mine].mean() for mine in of_beam] for name in ("u", "v")]
    mean = np.array([size[mine].mean() for mine in of_beam])
    if not len(beams):
        map_axes.text(0.5, 0.5, "no point within the limit", ha="center",
                      transform=map_axes.transAxes)
        position, mean = ([], []), np.zeros(0)
    dots = map_axes.scatter(*position, c=mean, s=320 * min(1, 49 / max(1, len(beams))),
                            cmap="YlOrRd", edgecolors="0.4", vmin=0)
    for beam, u, v, value in zip(beams, *position, mean, strict=True):
        dark = value > 0.6 * mean.max(initial=0)
        map_axes.annotate(str(beam), (u, v), ha="center", va="center", fontsize=7,
                          color="white" if dark else "black")
    map_axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="u, px",
                 ylabel="v, px", title="mean |error| of each beam, at its mean position")
    map_axes.set_aspect("equal")
    figure.colorbar(dots, ax=map_axes, label="mean |error|, %", shrink=0.8)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)
