"""From photographs and plane frames to a calibration: the steps in their order."""

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.chessboards import LensReport, calibrate_lens
from calibration.diagnosis import check_planes, identify_or_explain
from calibration.file import Beam, Calibration
from calibration.identity import Identity
from calibration.lens_check import doubts
from calibration.lines import BeamLines, Observations, fit_lines
from calibration.plane_check import check_plane_positions
from calibration.plane_offset import PlaneOffset, corrected, offset_by_lines
from calibration.reciprocal import reciprocal_table
from calibration.remap import remap_settings
from calibration.spots import plane_spots
from calibration.tables import Tables, Windows, build_tables, choose_windows, coordinate_reach
from calibration.undistortion import BORDER_PX, undistortion_settings
from calibration.usable import (
    check_distances,
    drop_scattered,
    relative_areas,
    remarks,
    seen_dead,
    usable_beams,
)
from hdl.protocol import fraction_bits
from model.errors import UserError
from model.preprocessing.centre import centres
from model.preprocessing.spot_queue import QUEUED_DTYPE
from model.settings import Settings
from model.stereo.undistort import undistort

__all__ = ["Options", "Result", "calibrate", "calibrate_beams", "with_lens"]


@dataclass(frozen=True)
class Options:
    """What the user may choose; the defaults are those of the chip.

    Parameters
    ----------
    settings : :class:`model.settings.Settings`
        Levels, weighting and area limits; its tables are replaced.
    depth_min, depth_max : :class:`float` or None
        Depth range in mm; that of the plane frames if None.
    remapped : :class:`bool`
        For the preset ``paper``: find the spots in images that the remap table has corrected.
    dead : frozenset of :class:`int`
        Beams that are known to be dead, besides those of the capture.
    """

    settings: Settings = field(default_factory=Settings)
    depth_min: float | None = None
    depth_max: float | None = None
    remapped: bool = False
    dead: frozenset = frozenset()


@dataclass(frozen=True)
class Result:
    """A calibration and the intermediate results that led to it.

    ``dead`` are the beams that were known to be dead.
    """

    calibration: Calibration
    lens_report: LensReport
    offset: PlaneOffset
    planes: tuple = field(repr=False)
    identity: Identity = field(repr=False)
    observations: Observations = field(repr=False)
    lines: BeamLines = field(repr=False)
    windows: Windows = field(repr=False)
    tables: Tables = field(repr=False)
    dead: frozenset = frozenset()


def _reach(lens):
    """First and last undistorted column where lens and chip are valid, px."""
    most = coordinate_reach(fraction_bits(lens.width, lens.height))
    reach = most if lens.usable_px is None else lens.reach * lens.focal
    return (max(lens.principal_x - reach, -most), min(lens.principal_x + reach, most))


def _undistortion_error(lens, settings):
    """Largest distance between the chip's undistorted centres and the lens in float, in px.

    Over the image, one position every two pixels, off the grid, where the chip has an answer.
    """
    pixel = 1 << fraction_bits(lens.width, lens.height)
    u = np.arange(0, lens.width - 1, 2) * pixel + 137 * pixel // 512
    v = np.arange(0, lens.height - 1, 2) * pixel + 331 * pixel // 512
    u, v = (grid.ravel() for grid in np.meshgrid(u, v))
    x, y, inside = undistort(u, v, settings, lens.width, lens.height)
    inside = np.asarray(inside, bool)
    exact_x, exact_y = lens.undistort(u / pixel, v / pixel)
    inside &= np.isfinite(exact_x) & (
        lens.distance_px(u / pixel, v / pixel) < (lens.usable_px or np.inf) - BORDER_PX)
    error = np.hypot(np.asarray(x) / pixel - exact_x, np.asarray(y) / pixel - exact_y)
    return float(error[inside].max())


def _centre_error(table, size):
    """Largest error of the chip's division in px, over all weights and a sample of positions."""
    weight = np.tile(np.arange(1, 65281), 8)
    position = np.random.default_rng(1).random(len(weight)) * (size - 1)
    spots = np.zeros(len(weight), QUEUED_DTYPE)
    spots["weight"] = weight
    spots["sum_u"] = spots["sum_v"] = np.rint(weight * position)
    fraction = fraction_bits(size, size)
    u, _ = centres(spots, table, fraction)
    return float(np.abs(u / (1 << fraction) - spots["sum_u"] / weight).max())


def with_lens(settings, lens):
    """Settings with the reciprocal table and the lens's undistortion."""
    return replace(settings, reciprocal=tuple(reciprocal_table()),
                   **undistortion_settings(lens))


def _fit_usable(planes, observations, identity, lens, dead):
    """Usable beams, the offset of the distances, and the lines.

    Beams whose spots scatter are left out, and the rest is fitted again.
    """
    usable = usable_beams(observations, identity.projector, identity.expected, dead)
    offset = offset_by_lines(usable.observations)
    usable = replace(usable, observations=corrected(usable.observations, offset.correction_mm))
    while True:
        lines = fit_lines(usable.observations, lens)
        fewer = drop_scattered(usable, lines, identity.projector)
        if fewer is usable:
            return seen_dead(usable, planes, identity, lens), offset, lines
        usable = fewer


def _depth_range(options, distances):
    """Nearest and farthest distance to measure in mm; refused if there is nothing between them."""
    z_min = min(distances) if options.depth_min is None else options.depth_min
    z_max = max(distances) if options.depth_max is None else options.depth_max
    if not 0 < z_min < z_max:
        raise UserError(f"The depth range {z_min:g} to {z_max:g} mm is empty: --depth-min must be "
                        "positive and less than --depth-max.")
    return z_min, z_max


def calibrate_beams(planes, nominal, lens, lens_report, options, settings):
    """Everything after the spots: identity, lines, windows, tables.

    Parameters
    ----------
    planes : sequence of :class:`calibration.identity.PlaneSpots`
        Spots of all plane frames.
    nominal : :class:`calibration.projector.Projector`
        Nominal mesh.
    lens, lens_report
        From :func:`calibration.lens.calibrate_lens`.
    options : :class:`Options`
        The user's choices.
    settings : :class:`model.settings.Settings`
        With everything but the stereo unit's tables.

    Returns
    -------
    :class:`Result`
    """
    distances = [plane.z_mm for plane in planes]
    _depth_range(options, distances)
    check_planes(planes)
    identity = identify_or_explain(planes, nominal, lens, lens_report.scale_sigma, options.dead)
    check_plane_positions(planes, identity, lens)
    observations = Observations.of(planes, identity, lens)
    usable, offset, lines = _fit_usable(planes, observations, identity, lens, options.dead)
    z_min, z_max = _depth_range(options, [z_mm + offset.correction_mm for z_mm in distances])
    windows = choose_windows(lines, nominal.columns, z_min, z_max,
                             fraction_bits(lens.width, lens.height), _reach(lens))
    tables = build_tables(lines, windows, nominal.columns, nominal.beams)
    settings = replace(settings, line=tables.line, window=tables.window, depth=tables.depth)

    # The mean magnitude of a normal error is 0.8 sigma; 1/z is uniform over the range.
    depth = 1 / np.linspace(1 / z_max, 1 / z_min, 65)
    expected = 0.798 * lines.sigma_u * np.abs(lines.alpha).mean() * depth.mean()
    budget = {
        "lens_px": lens_report.rms_px, "focal_sigma_relative": lens_report.focal_sigma,
        "principal_sigma_px": lens_report.principal_sigma_px, "lines_px": lines.rms_px,
        "sigma_u_px": lines.sigma_u, "sigma_v_px": lines.sigma_v,
        "held_out_px": lines.held_out_px[lines.strength],
        "held_out_free_px": lines.held_out_px[0.0],
        "separation_px": windows.smallest_px if np.isfinite(windows.smallest_px) else None,
        "expected_depth_relative": float(expected),
        "plane_offset_mm": offset.mm, "plane_offset_sigma_mm": offset.sigma_mm,
        "plane_correction_mm": offset.correction_mm,
        "centre_px": _centre_error(settings.reciprocal, lens.width),
        "undistortion_px": _undistortion_error(lens, settings),
        "line_px": tables.line_px, "depth_relative": tables.depth_relative}
    lens_report = replace(lens_report, flags=(*lens_report.flags, *doubts(
        planes, identity, lens, offset.correction_mm, lines.numbers)))
    areas = relative_areas(planes, identity.beams, nominal.beams)
    calibration = Calibration(
        lens=lens, projector=identity.projector, settings=settings,
        beams=_beams(lines, windows, areas, nominal.beams),
        remarks=remarks(usable, areas, identity, len(set(distances))),
        inverse_z_unit=tables.inverse_z_unit, z_min=float(z_min), z_max=float(z_max),
        budget=budget)
    return Result(calibration=calibration, lens_report=lens_report, offset=offset,
                  planes=tuple(planes),
                  identity=identity, observations=usable.observations, lines=lines,
                  windows=windows, tables=tables, dead=options.dead)


def _beams(lines, windows, areas, count):
    """What the file says of each of ``count`` beams; None for those without a line."""
    result = [None] * count
    for index, number in enumerate(lines.numbers):
        separation = float(windows.separation[index])
        result[number] = Beam(
            a=float(lines.a[index]), b=float(lines.b[index]), alpha=float(lines.alpha[index]),
            beta=float(lines.beta[index]), u_min=float(windows.low[index]),
            u_max=float(windows.high[index]), tolerance=float(windows.tolerance[index]),
            separation=separation if np.isfinite(separation) else None,
            residual_u=float(lines.residual_u[index]), residual_v=float(lines.residual_v[index]),
            relative_area=float(areas[number]), planes=int(lines.planes[index]))
    return tuple(result)


def calibrate(capture, options, progress=None):
    """The whole calibration of a capture.

    Parameters
    ----------
    capture : :class:`calibration.capture.Capture`
        Nominal values, chessboard photographs and plane frames.
    options : :class:`Options`
        The user's choices.
    progress : callable or None
        Called with a phase, the number of its images that are done, and their total.

    Returns
    -------
    :class:`Result`
    """
    def counted(phase, images):
        for number, image in enumerate(images):
            if progress:
                progress(phase, number, len(images))
            yield image
        if progress:
            progress(phase, len(images), len(images))

    capture.check_sizes()
    lens, lens_report = calibrate_lens(
        counted("chessboards", capture.lens_images()), capture.board_columns, capture.board_rows,
        capture.square_mm, capture.focal_px)
    check_distances([z_mm for _, z_mm in capture.planes])
    settings = with_lens(options.settings, lens)
    if options.remapped:
        settings = replace(settings, **remap_settings(lens))
    planes = [plane_spots(name, z_mm, image, settings, lens)
              for name, z_mm, image in counted("plane frames", capture.plane_images())]
    options = replace(options, dead=options.dead | capture.dead)
    result = calibrate_beams(planes, capture.projector, lens, lens_report, options, settings)
    return replace(result, calibration=replace(result.calibration, bayer=capture.bayer))
