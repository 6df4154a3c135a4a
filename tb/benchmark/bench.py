"""``make bench``: speed, accuracy, calibration, lengths, drift, latency, noise, size and more.

``python -m tb.benchmark.bench PART`` prints one part: ``speed``, ``accuracy``, ``calibration``,
``measure``, ``drift``, ``page``, ``latency``, ``noise``, ``size``, ``link``, ``texture``
or ``presets``.
"""

import sys
import time
from dataclasses import replace

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

__all__ = ["PARTS", "main"]

_FRAMES = 40
_SEEDS = range(1, 6)
_PAGE_SECONDS = 60


def _table(title, *columns):
    table = Table(title=title, title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def opencv_points(image, level, camera, distortion):
    """The work of the chip on a frame, with OpenCV: components, centres, undistortion.

    Matching, a thousandth of the work, is left out.
    """
    _, mask = cv2.threshold(image, level - 1, 255, cv2.THRESH_BINARY)
    mask = cv2.erode(mask, np.ones((3, 3), np.uint8))
    histogram = cv2.calcHist([image], [0], None, [256], [0, 256])
    count, _, stats, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count > 1:
        cv2.undistortPoints(centres[1:, None], camera, distortion)
    return histogram, stats


def _rate(work, frames, least_seconds=2.0):
    """Frames per second of ``work(frames)``: the fastest of the runs of ``least_seconds``."""
    best = 0.0
    begin = time.perf_counter()
    while time.perf_counter() - begin < least_seconds:
        start = time.perf_counter()
        work(frames)
        best = max(best, len(frames) / (time.perf_counter() - start))
    return best


def speed(console):
    """Frames per second of every engine and of OpenCV, on one core."""
    cv2.setNumThreads(1)
    from hdl.config import PRESETS
    from scripts.simulation.engine import ModelEngine, RTLEngine
    from tb.system.frames import cocotb_speed
    from tb.system.stimuli import any_settings, spot_frame

    config = PRESETS["capsule"]
    settings = any_settings(config.width, config.height, config.beams, report_rejected=False,
                            area_min=5)
    frames = [spot_frame(config.width, config.height, seed, spots=49) for seed in range(_FRAMES)]
    rtl = RTLEngine(settings, config)
    model = ModelEngine(settings, config.width, config.height)
    list(rtl.frames(frames[:2]))
    clocks = rtl.clocks
    list(rtl.frames(frames))
    clocks = (rtl.clocks - clocks) / (len(frames) + 1)
    camera = np.array([[300.0, 0, 175.5], [0, 300, 143.5], [0, 0, 1]])
    rates = {
        "RTL, native engine": _rate(lambda some: list(rtl.frames(some)), frames, 6.0),
        "golden model, numpy": _rate(lambda some: list(model.frames(some)), frames),
        "OpenCV, the same work": _rate(
            lambda some: [opencv_points(f, 60, camera, np.zeros(4)) for f in some], frames),
    }
    rates["RTL, cocotb bench"], cocotb_clocks = cocotb_speed()
    table = _table(f"Speed, {config.width} x {config.height}, one core",
                   "", "frames/s", "clocks/s", "of video rate (25)", "of OpenCV")
    for name, rate in rates.items():
        per_frame = {"RTL, native engine": clocks, "RTL, cocotb bench": cocotb_clocks}.get(name)
        table.add_row(name, f"{rate:.1f}", f"{rate * per_frame:,.0f}" if per_frame else "",
                      f"{rate / 25:.2f}", f"{rate / rates['OpenCV, the same work']:.3f}")
    console.print(table)


def accuracy(console):
    """Depth errors of simulated rigs, each calibrated from its own capture."""
    from rich.progress import track

    from tb.benchmark.depth_error import CASES, CONDITIONS, measure
    table = _table("Depth, seeds 1 to 5, golden model (its points are the RTL's)", "rig", "scenes",
                   "centre", "mean error", "limit", "found", "wrong", "ok points")
    for case in track(CASES, "accuracy", console=Console(stderr=True), transient=True):
        depth = measure(case, _SEEDS)
        error = depth.error
        table.add_row(
            case.rig, ", ".join(case.kinds) + (", split spots" if case.split else ""),
            case.centre, f"{100 * error.mean():.3f} %",
            f"{100 * case.limit:.2f} %" if case.limit else "",
            f"{100 * depth.found / depth.expected:.2f} %", f"{100 * np.mean(error > 0.05):.3f} %",
            str(len(error)))
    console.print(table)
    table = _table("The same under conditions that are not kind, rig endoscope", "conditions",
                   "scenes", "mean error", "found", "wrong", "precision of spots", "ok points")
    for name, case in track(CONDITIONS.items(), "conditions", console=Console(stderr=True),
                            transient=True):
        depth = measure(case, _SEEDS)
        error = depth.error
        table.add_row(
            name, ", ".join(case.kinds), _percent(error.mean() if len(error) else np.nan),
            _percent(depth.found / depth.expected, 1),
            _percent(np.mean(error > 0.05) if len(error) else np.nan, 2),
            _percent(depth.real / depth.spots if depth.spots else np.nan, 1), str(len(error)))
    console.print(table)
    _centres(console)


def _centres(console):
    """Errors of the centres against the least that they can be."""
    from rich.progress import track

    from tb.benchmark.centre_bound import CASES, measure
    table = _table("Centres on planes, rig endoscope, and their Cramer-Rao bound: px rms of a "
                   "coordinate", "conditions", "error", "bound", "error / bound", "limit",
                   "bound / plain's", "spots")
    plain = None
    for name, conditions in track(CASES.items(), "centres", console=Console(stderr=True),
                                  transient=True):
        centres = measure(conditions, _SEEDS)
        plain = plain or centres.bound_px
        table.add_row(
            name, f"{centres.rms_px:.4f}", f"{centres.bound_px:.4f}",
            f"{centres.rms_px / centres.bound_px:.2f}", "1.3" if name == "plain" else "",
            f"{centres.bound_px / plain:.2f}", str(len(centres.error)))
    table.caption = (
        "With a gain of 4 spots have lost their tops: the last but one column says by how much "
        "any estimate of their centres is worse. With speckle the bound is that of the best "
        "linear estimate that knows the spot's shape.")
    table.caption_justify = "left"
    console.print(table)


def _percent(share, digits=3):
    return "-" if np.isnan(share) else f"{100 * share:.{digits}f} %"


def latency(console):
    """Clocks from a frame's last pixel to its last point, at the Point FIFO."""
    from hdl.config import PRESETS
    from tb.system.chain import (
        dense_frame,
        last_point_latency,
        spots_at_the_bottom,
        spots_on_the_last_row,
    )
    config = PRESETS["capsule"]
    table = _table("From a frame's last pixel to its last point; 64 spots end on the last row",
                   "lanes", "clocks", "limit (7 rows + 1000)", "points")
    for lanes in (config.lanes, 8):
        clocks, points = last_point_latency(
            replace(config, lanes=lanes), spots_on_the_last_row(config))
        limit = (3 + config.mean_window // 2) * config.width + 1000
        table.add_row(str(lanes), f"{clocks:,}", f"{limit:,}", str(points))
    console.print(table)
    table = _table("The same with 361 beams and so many spots; less than 0: before the last pixel",
                   "spots", "lanes", "clocks", "time", "limit", "points")
    for spots, depth, image in (
            ("simulated mesh on a plane", config.spot_depth, dense_frame()),
            ("all in the lowest 72 rows, queue of 512", 512, spots_at_the_bottom(config, 361))):
        clocks, points = last_point_latency(
            replace(config, beams=361, spot_depth=depth), image)
        table.add_row(spots, str(config.lanes), f"{clocks:,}",
                      f"{1e3 * clocks / config.clock_hz:.2f} ms", "10 ms", str(points))
    console.print(table)


def noise(console):
    """Packets lost to bit errors: of octets alone, and of start and stop bits too."""
    from rich.progress import track

    from tb.link.noise import measure
    table = _table("The link at a bit-error rate of 1e-4: of its octets, of its levels", "", "seed",
                   "octets", "errors", "packets", "wrong", "lost", "lost, not hit", "recovered")
    runs = [(characters, seed) for characters in (False, True) for seed in _SEEDS]
    for characters, seed in track(runs, "noise", console=Console(stderr=True), transient=True):
        figures = measure(1_000_000, 1e-4, seed, characters)
        table.add_row(
            "levels" if characters else "octets", str(seed), f"{figures.octets:,}",
            str(figures.errors), f"{figures.packets:,}", str(figures.wrong), str(figures.lost),
            str(figures.bystanders), "yes" if figures.recovered else "no")
    console.print(table)


def size(console):
    """Look-up tables, flip-flops, multipliers and block RAMs of every block."""
    from scripts.rtl import size as sizes
    sizes.main([])


def link(console):
    """Load of the serial line: points of simulated frames."""
    from scripts.host.load_plan import fit_patterns
    from tb.benchmark import line_load
    for rig, beams, baud in (("endoscope", 49, line_load.BAUD), ("dense", 361, line_load.BAUD),
                             ("dense", 361, 1_000_000)):
        found = [frame for frame in line_load.realistic_frames(_SEEDS, rig)
                 if np.count_nonzero(frame.points["status"] == 0) == beams]
        octets = np.array([line_load.points_octets(frame) for frame in found])
        every = fit_patterns(beams, baud, round(1e6 * line_load.PAIR_S))
        pair = every * line_load.octets_per_pair(baud)
        pairs = "a pair has" if every == 1 else f"{every} pairs, of which one is measured, have"
        limit = "65 %" if every == 1 else "100 %"
        table = _table(f"Octet times of a frame of {beams} ok points, gaps included; {pairs} "
                       f"{pair:,.1f} at {baud:,} baud", "", "octets", "of the line", "limit")
        for name, value in (("least", octets.min()), ("mean", octets.mean()),
                            ("most", octets.max())):
            table.add_row(f"{name} of {len(found)} frames", f"{value:,.1f}",
                          f"{100 * value / pair:.1f} %", limit if name == "most" else "")
        console.print(table)


def texture(console):
    """Seconds until a texture has been sent, beside the points of every frame."""
    from tb.benchmark import texture_time
    what, grey = texture_time.pictures()
    _, mosaics = texture_time.pictures(mosaic=True)
    table = _table(f"Time to send a texture of 352 x 288 at 25 pairs/s, bound as in "
                   f"`texture_bound`: {what}", "beside", "baud", "bound", "coarse, mean", "most",
                   "whole, mean", "most")
    for rig, beams, baud in texture_time.LINES:
        frame = texture_time.longest_frame(rig, beams)
        name = f"{beams} points"
        cases = [(name, frame, bound, False) for bound in (0, 2, 4)]
        for name, beside, bound, mosaic in [*cases, ("nothing", None, 2, False), *(
                (f"{name}, colour", frame, bound, True) for bound in (2, 4))]:
            times = texture_time.measure(mosaics if mosaic else grey, beside, baud, bound, mosaic)
            table.add_row(name, f"{baud:,}", str(bound), *(
                f"{seconds:.2f} s" for seconds in (times.coarse.mean(), times.coarse.max(),
                                                   times.whole.mean(), times.whole.max())))
    console.print(table)


def presets(console):
    """Both presets side by side."""
    from tb.benchmark import presets as both
    both.presets(console)


def calibration(console):
    """Rigs with faults, planes with wrong distances, poor photographs, capsule endoscopes."""
    from rich.progress import track

    from tb.benchmark import rig_faults
    table = _table("Calibration of rigs as they are, seeds 1 to 3", "fault", "found", "error",
                   "limit")
    rows = [rig_faults.measure(case, range(1, 4)) for case in track(
        rig_faults.CASES, "calibration", console=Console(stderr=True), transient=True)]
    for row in [*rows, rig_faults.frontal_boards(range(5)), *rig_faults.capsules()]:
        table.add_row(row.case, row.found, row.error, row.limit)
    console.print(table)


def measure(console):
    """Lengths by the ruler, and sizes of polyps, against those of simulated scenes."""
    from tb.benchmark import lengths
    table = _table("Lengths on the measured surface, rigs calibrated from their captures", "mesh",
                   "what", "of truth", "n", "relative accuracy", "within 68 %",
                   ">= 10 mm called smaller", "refused")
    for name, watch in lengths.watches():
        rulers = lengths.rulers(watch, 10, 25)
        single, mean, refused = lengths.polyps(watch, 111, 10)
        for what, truth, found, left in (
                ("ruler", "3-20 mm", rulers, ""), ("polyp, one frame", "3-15 mm", single, refused),
                ("polyp, mean of 10 frames", "3-15 mm", mean, refused)):
            table.add_row(name, what, truth, str(len(found.true)), _percent(found.accuracy, 1),
                          _percent(found.held, 0), _percent(
                              found.called_smaller if what != "ruler" else np.nan, 1), str(left))
    console.print(table)


def drift(console):
    """What has moved in a rig, and alarms without a cause in 100,000 frames."""
    from tb.benchmark.drift import report
    report(console, 100_000)


def page(console):
    """The page of `cyclope view` at 25 pairs a second, drawn without graphics hardware."""
    from tb.benchmark.page import measure as pace
    table = _table(f"The page in headless Chromium, {_PAGE_SECONDS} s each", "points",
                   "frames/s offered", "drawn", "delay, median", "p95", "program, MB", "page, MB")
    for side in (7, 19):
        found = pace(side, _PAGE_SECONDS)
        table.add_row(str(found.points), f"{found.offered:.1f}", f"{found.drawn:.1f}",
                      f"{found.median_ms:.0f} ms", f"{found.p95_ms:.0f} ms",
                      "{:.0f} to {:.0f}".format(*found.server_mb),
                      "{:.0f} to {:.0f}".format(*found.page_mb))
    console.print(table)


PARTS = {part.__name__: part for part in (
    speed, accuracy, calibration, measure, drift, page, latency, noise, size, link, texture,
    presets)}


def main(arguments=None):
    """Print the named parts, or all; gives the exit status."""
    names = sys.argv[1:] if arguments is None else arguments
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        print(f"There is no part {unknown[0]!r}; there are: {', '.join(PARTS)}.",
              file=sys.stderr)
        return 2
    console = Console()
    for name in names or PARTS:
        PARTS[name](console)
    return 0


if __name__ == "__main__":
    sys.exit(main())
