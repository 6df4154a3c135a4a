"""The whole instrument: imager, laser and host around the RTL, natively."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from hdl.config import Config
from hdl.protocol import GUARD_CAUSES, Command, Mode, Reason
from model.capsule import Capsule as Model
from model.paper import Paper
from scripts.host.chip import REGISTERS, RefusedError
from scripts.host.framing import frame_packet
from scripts.host.image_assembly import ImageAssembly
from scripts.host.loading import stop
from scripts.host.recorder import Recorder
from tb.system.played_instrument import SMALL
from tb.system.stimuli import any_settings, random_frame, spot_frame
from tb.system.test_paper import settings_of as paper_settings
from tb.system.test_paper_instrument import VIDEO
from tb.system.whole import Whole, same

PERIOD_US = 40_000
#: The shortest that the laser guard bears, where the period proves nothing: half as much to run.
SHORT_US = 20_000
QCIF = replace(VIDEO, width=176, height=144)


def small(seed=1, **changes):
    return any_settings(64, 64, SMALL.beams, seed, **{
        "area_min": 2, "report_rejected": False, **changes})


def spots(seed, count=6):
    return [spot_frame(64, 64, 10 * seed + n, spots=12) for n in range(count)]


@pytest.mark.parametrize("full_records", [0, 1])
@pytest.mark.parametrize("seed,blanking", [(1, 0), (2, 48)])
def test_pairs_reach_the_reader(seed, blanking, full_records):
    """Pattern and texture in turn, every 20 ms to the clock; every point is the model's."""
    images = [random_frame(64, 64, 5 * seed + n) for n in range(10)]
    texture = np.random.default_rng(seed).integers(0, 256, (64, 64)).astype(np.uint8)
    bench = Whole(SMALL, small(seed), images, texture, full_records=full_records,
                  mode=Mode.CONTINUOUS, period_us=SHORT_US, line_blanking=blanking)
    bench.run(10.5 * SHORT_US)
    bench.assert_link_is_clean()
    bench.assert_frames_are_the_model_s()
    assert bench.assert_light_is_safe() >= 8
    lit = [frame for frame in bench.frames if frame.laser]
    assert len(lit) >= 10 and lit == bench.frames[-len(lit):]
    assert set(np.diff([frame.timestamp_us for frame in lit])) == {SHORT_US}
    assert [frame.index for frame in bench.textures] == [
        frame.index + 1 for frame in lit][:len(bench.textures)]
    assert all(frame.exposure_us == 10_000 and not frame.laser for frame in bench.textures)
    assert bench.decoder.packets > len(bench.frames) + 2 * len(bench.textures)


@pytest.mark.parametrize("latency,interval", [(1, 2), (9, 3)])
def test_addressed_pixels(latency, interval):
    """The same of an imager whose pixels are converted one by one; it has no frames to lose."""
    config = replace(SMALL, converter_latency=latency, converter_interval=interval)
    images = [random_frame(64, 64, 70 + n) for n in range(6)]
    texture = np.random.default_rng(latency).integers(0, 256, (64, 64)).astype(np.uint8)
    bench = Whole(config, small(3), images, texture, mode=Mode.CONTINUOUS,
                  period_us=SHORT_US)
    bench.run(7.5 * SHORT_US)
    bench.assert_link_is_clean()
    bench.assert_frames_are_the_model_s()
    assert bench.assert_light_is_safe() >= 5
    lit = [frame for frame in bench.frames if frame.laser]
    assert len(lit) >= 5 and set(np.diff([frame.timestamp_us for frame in lit])) == {SHORT_US}
    assert len(bench.textures) >= 4 and bench.commands.status()["bad_sync"] == 0
    for fault in (lambda imager: imager.silence(True), lambda imager: imager.stop_row(40),
                  lambda imager: imager.short_row(30, 3)):
        with pytest.raises(ValueError, match="addressed pixels sends no frames by itself"):
            fault(bench.instrument)


def test_video_rate():
    """25 pairs a second at CIF, pixels at 8 MHz, the system at 16 MHz, 115,200 baud: a pattern
    every 640,000 clocks whatever it shows, and every one of them reported."""
    config = Config()
    row, column = np.mgrid[:288, :352]
    images = {
        "isolated pixels": np.where((row % 2 == 0) & (column % 2 == 0), 200, 20),
        "small blocks": np.where((row % 4 < 2) & (column % 4 < 2), 200, 20),
        "white": np.full((288, 352), 255), "black": np.zeros((288, 352)),
        "largest areas": np.where((row % 17 < 15) & (column % 18 < 16), 220, 20),
        "points": spot_frame(352, 288, 5, spots=49),
    }
    settings = any_settings(352, 288, config.beams, 3, fixed_noise=200, area_min=1,
                            report_rejected=False)
    bench = Whole(config, settings, [], mode=Mode.CONTINUOUS)
    for kind, image in images.items():
        # One load for all of them: it takes longer than the frames.
        bench.images[:] = [image.astype(np.uint8)]
        begin = len(bench.shown)
        bench.run(8 * PERIOD_US)
        lit = [frame for frame in bench.frames if frame.laser and frame.index >= begin]
        assert len(lit) >= 5 and all(frame.spots == lit[0].spots for frame in lit), kind
    bench.assert_link_is_clean()
    status = bench.commands.status()
    assert not any(status[name] for name in ("timeouts", "bad_sync", "overrun", "late"))
    lit = [frame for frame in bench.frames if frame.laser]
    # Dark patterns before the first lit one come without a pause, and may cost a texture.
    assert status["skipped"] == sum(
        frame.skipped for frame in bench.frames + bench.textures if frame.index <= lit[0].index + 1)
    assert set(np.diff([frame.timestamp_us for frame in lit])) == {PERIOD_US}
    assert set(np.diff(bench.instrument.pulses[:, 0])) == {16 * PERIOD_US}
    assert set(np.diff([frame.index for frame in bench.frames if frame.laser])) == {2}
    # Of the other images the chip has no room for all spots.
    bench.assert_frames_are_the_model_s(since=begin)


@pytest.mark.parametrize("seed", [3])
def test_silent_sensor_loses_the_laser_and_gets_it_back(seed):
    """Disarmed and flagged within two periods; good frames again within two more."""
    bench = Whole(SMALL, small(seed), spots(seed), mode=Mode.CONTINUOUS)
    bench.run(4.6 * PERIOD_US)
    bench.instrument.silence(True)
    bench.run(2 * PERIOD_US)
    silent_from = bench.now_us
    status = bench.commands.status()
    assert not status["state"].armed and status["state"].silent and status["timeouts"]
    bench.run(4 * PERIOD_US)
    bench.instrument.silence(False)
    back = bench.now_us
    frames = len(bench.frames)
    bench.run(2 * PERIOD_US + 15_000)
    assert bench.commands.status()["state"].armed
    new = bench.frames[frames:]
    assert any(frame.laser and frame.verified for frame in new)
    assert min(frame.timestamp_us for frame in new if frame.laser) <= back + 2 * PERIOD_US
    pulses = bench.instrument.pulses[:, 0] / 16
    assert not ((pulses > silent_from) & (pulses < back)).any()
    assert "heartbeat" not in GUARD_CAUSES or new[-1].tripped == bool(
        bench.commands.status()["guard_causes"])
    bench.assert_light_is_safe()
    bench.assert_link_is_clean()
    assert all(frame.balanced for frame in bench.frames)


@pytest.mark.parametrize("fault", ["short line", "long line", "short frame", "one line"])
def test_bad_sync_costs_one_frame(fault):
    """Flagged; the next frame is the model's; nothing else is lost."""
    bench = Whole(SMALL, small(4), spots(4), mode=Mode.CONTINUOUS, line_blanking=4,
                  period_us=SHORT_US)
    bench.run(4 * SHORT_US)
    bench.take()
    while bench.shown[-1][0] is not None:  # the next frame is a pattern
        bench.run(1000)
    before = len(bench.shown)
    if "line" in fault:
        bench.instrument.short_row(30, {"short line": 3, "long line": -2, "one line": 63}[fault])
    else:
        bench.instrument.stop_row(40)
    bench.run(5 * SHORT_US)
    bench.assert_link_is_clean()
    bad = [frame for frame in bench.frames if frame.broken]
    assert len(bad) == 1 and all(frame.balanced for frame in bench.frames)
    assert bench.shown[before][0] is not None
    later = [frame for frame in bench.frames if frame.index > bad[0].index]
    assert later[0].index == bad[0].index + 2 and later[0].ok + later[0].noise > 0
    assert bench.commands.status()["bad_sync"] == 1
    # What the model says of these images, at the levels that the chip had learnt before.
    assert len(later) >= 3 and all(frame.verified for frame in later)


def test_broken_frames_alone_lose_the_laser():
    """Frames that all lose synchronism are no heartbeat: the light ends before the next is due."""
    bench = Whole(SMALL, small(6), spots(6), mode=Mode.CONTINUOUS, line_blanking=4)
    bench.run(4 * PERIOD_US)
    since = bench.now_us
    while bench.now_us < since + 6 * PERIOD_US:
        bench.instrument.short_row(30, 3)
        bench.run(500)
    status = bench.commands.status()
    assert not status["state"].armed
    assert status["guard_causes"] == 1 << GUARD_CAUSES.index("heartbeat")
    last = bench.instrument.pulses[-1, 0] * 1e6 / SMALL.clock_hz
    assert last < since + 2 * PERIOD_US
    bench.assert_light_is_safe()


def test_new_speed_of_the_line():
    """The reply to a new divisor comes whole at the old speed; what follows at the new one."""
    bench = Whole(SMALL, small(7), spots(7), mode=Mode.CONTINUOUS,
                  period_us=SHORT_US)
    bench.run(3 * SHORT_US)
    stop(bench.commands)
    bench.run(SHORT_US)
    bench.take()
    before = len(bench.line.record)
    divisor = bench.commands.read("divisor")
    bench.commands.tries, bench.commands.timeout = 1, 30  # a lost reply is not asked for again
    bench.commands.write("divisor", 2 * divisor)
    assert not bench.instrument.framing_errors and len(bench.line.record) > before
    bench.run(1000)
    bench.assert_link_is_clean()


def test_no_tables_no_light():
    """Uncommitted or damaged tables keep the laser off; calibration capture lights it for a while,
    and says so in each frame."""
    bench = Whole(SMALL, small(6), spots(6), load=False, mode=Mode.CONTINUOUS)
    bench.run(3 * PERIOD_US)
    assert not len(bench.instrument.pulses)
    assert not any(frame.laser or frame.tables_valid for frame in bench.frames)

    def damage(words):
        changed = {name: list(values) for name, values in words.items()}
        changed["beams"][7] ^= 1 << 20
        return changed

    bench.commands.write("mode", Mode.STOP)
    bench.run(2 * PERIOD_US)
    with pytest.raises(RefusedError) as refused:
        bench.load(bench.settings, damage)
    assert refused.value.reason == Reason.DAMAGED_TABLE
    bench.commands.write("mode", Mode.CONTINUOUS)
    bench.run(3 * PERIOD_US)
    assert not len(bench.instrument.pulses) and not bench.commands.status()["state"].armed

    bench.commands.capture(130)
    bench.run(6 * PERIOD_US)
    pulses = bench.assert_light_is_safe()
    assert 2 <= pulses <= 4
    lit = [frame for frame in bench.frames if frame.laser]
    assert len(lit) == pulses and all(frame.capture and not frame.tables_valid for frame in lit)
    assert not bench.frames[-1].laser and not bench.frames[-1].capture
    bench.assert_link_is_clean()


def test_pictures_for_a_calibration():
    """Without any table: what the imager sees of the mesh, pixel for pixel, by day and by night."""
    rng = np.random.default_rng(12)
    seen, texture = (rng.integers(0, 256, (64, 64)).astype(np.uint8) for _ in range(2))
    dark = np.full((64, 64), 7, np.uint8)
    bench = Whole(SMALL, small(12), [seen], texture, load=False, pattern_as_texture=1,
                  texture_bound=0, mode=Mode.PATTERN)
    bench.light = lambda image, lit_us: image if lit_us else dark
    bench.run(2 * PERIOD_US)
    bench.commands.capture(1000)
    bench.run(6 * PERIOD_US)
    bench.commands.write("mode", Mode.CONTINUOUS)
    bench.run(6 * PERIOD_US)
    bench.assert_link_is_clean()
    lit = [frame for frame in bench.textures if frame.laser]
    assert bench.assert_light_is_safe() >= len(lit) >= 5
    assert all(frame.capture and frame.exposure_us == 500 for frame in lit)
    # No points while pictures were sent; both again afterwards.
    assert min(frame.index for frame in bench.frames) > max(frame.index for frame in lit)
    with TemporaryDirectory() as folder, Recorder(Path(folder)) as recorder:
        recorder.images = {kind: ImageAssembly((64, 64)) for kind in recorder.images}
        for event in bench.events:
            recorder.take(event)
        assert recorder.complete["pattern"] >= 1 and recorder.complete["texture"] >= 1
        assert np.array_equal(recorder.images["pattern"].image, seen)
        assert set(map(int, np.unique(recorder.images["texture"].image ^ texture))) == {0}


@pytest.mark.parametrize("config,model,settings_of", [
    (SMALL, Model, lambda seed: small(seed, fixed_noise=160)),
    (QCIF, Paper, lambda seed: paper_settings(
        QCIF, seed=seed, level_fixed=60, area_min=5, report_rejected=False)),
], ids=["capsule", "paper"])
def test_tables_change_between_frames(config, model, settings_of):
    """A second set of tables is loaded while frames pass: each frame is the model's with the one
    or with the other, and they change once. In the preset `paper`, the chip reads the table of
    places for COMMIT while frames are corrected by it."""
    one, other = settings_of(7), settings_of(8)
    other = replace(other, **{name: getattr(one, name) for name in (
        "principal_u", "principal_v", "tangential_1", "tangential_2")})
    paper = config.preset == "paper"
    images = [spot_frame(config.width, config.height, 70 + n, spots=49 if paper else 12)
              for n in range(6)]
    bench = Whole(config, one, images, mode=Mode.CONTINUOUS, full_records=1,
                  places_in_memory=paper, period_us=SHORT_US)
    bench.decoder.rebuild = None
    bench.run(2 * SHORT_US)
    bench.load(other, not_banked=False)
    assert not paper or bench.shown_meanwhile >= 4
    bench.run(4 * SHORT_US)
    models = [model(settings, config.width, config.height) for settings in (one, other)]
    sets = []
    for frame in bench.frames:
        wanted = [model.frame(bench.shown[frame.index][0]).points for model in models]
        fits = [np.array_equal(frame.points, points) for points in wanted]
        assert sum(fits) == 1, f"frame {frame.index}"
        sets.append(fits.index(True))
    assert sets == sorted(sets) and 0 in sets and sum(sets) >= 3
    lit = [frame for frame in bench.frames if frame.laser]
    assert set(np.diff([frame.index for frame in lit])) == {2}
    bench.assert_link_is_clean()


@pytest.mark.parametrize("mode", [Mode.SINGLE, Mode.PATTERN])
def test_modes(mode):
    bench = Whole(SMALL, small(9), spots(9), period_us=20_000, mode=mode)
    bench.run(6 * 20_000)
    if mode == Mode.SINGLE:
        assert [frame.laser for frame in bench.frames].count(True) == 1
        assert len(bench.textures) == 1 and bench.commands.read("mode") == Mode.STOP
    else:
        lit = [frame for frame in bench.frames if frame.laser]
        assert len(lit) >= 4 and not bench.textures
        assert set(np.diff([frame.timestamp_us for frame in lit])) == {20_000}
    bench.assert_frames_are_the_model_s()
    bench.assert_light_is_safe()
    bench.assert_link_is_clean()


@pytest.mark.parametrize("share", [2, 5])
def test_one_pattern_in_so_many(share):
    """The others are exposed and leave no trace but their numbers; the line has their time."""
    bench = Whole(SMALL, small(11), spots(11, 9), mode=Mode.PATTERN, period_us=SHORT_US,
                  pattern_every=share)
    bench.run((2 * share + 1.5) * SHORT_US)
    bench.commands.write("pattern_every", 1)
    bench.run(4 * SHORT_US)
    bench.assert_link_is_clean()
    assert bench.assert_light_is_safe() >= 2 * share
    measured = [frame.index for frame in bench.frames if frame.every == share]
    assert measured == list(range(0, measured[-1] + 1, share)) and len(measured) >= 3
    others = [frame.index for frame in bench.frames if frame.every == 1]
    assert others == list(range(others[0], others[0] + len(others))) and len(others) >= 3
    assert measured[-1] < others[0] <= measured[-1] + share
    model = Model(bench.settings, 64, 64, points_max=72)
    for frame in bench.frames:
        assert same(frame, model.frame(bench.shown[frame.index][0])), f"frame {frame.index}"
        assert frame.skipped == 0


def test_exposure_changes_with_its_frame():
    """From the frame on that says so, and with no other."""
    bench = Whole(SMALL, small(10, fixed_noise=200), spots(10), mode=Mode.CONTINUOUS,
                  period_us=SHORT_US)
    bench.run(3 * SHORT_US)
    bench.commands.write("pattern_us", 321)
    bench.commands.write("texture_us", 7654)
    bench.run(4 * SHORT_US)
    bench.assert_frames_are_the_model_s()
    assert {frame.exposure_us for frame in bench.frames} == {500, 321}
    assert {frame.exposure_us for frame in bench.textures} == {10_000, 7654}
    bench.assert_light_is_safe()


def test_too_long_a_pattern_is_cut():
    """A register beyond the ceiling: one millisecond of light in 40, flagged."""
    bench = Whole(SMALL, small(11, fixed_noise=200), spots(11), mode=Mode.CONTINUOUS,
                  pattern_us=2500)
    bench.run(5 * PERIOD_US)
    assert bench.assert_light_is_safe() >= 3
    assert bench.commands.status()["guard_causes"] & 1 << GUARD_CAUSES.index("pulse")
    assert bench.frames[-1].tripped and bench.frames[-1].laser
    bench.commands.write("pattern_us", 500)
    bench.run(2 * PERIOD_US)
    bench.commands.clear()
    bench.run(2 * PERIOD_US)
    assert bench.frames[-1].laser and not bench.frames[-1].tripped


def test_clear_to_send_holds_and_loses_nothing_but_time():
    """No octet while CTS is low, but the one on the line; all that came is whole."""
    bench = Whole(SMALL, small(12), spots(12), mode=Mode.CONTINUOUS,
                  period_us=SHORT_US)
    bench.run(3 * SHORT_US)
    bench.instrument.clear_to_send(False)
    bench.run(100)
    held = len(bench.line.record)
    bench.run(2 * SHORT_US)
    assert len(bench.line.record) == held
    bench.instrument.clear_to_send(True)
    bench.run(5 * SHORT_US)
    bench.assert_link_is_clean()
    assert all(frame.balanced and frame.verified for frame in bench.frames)
    assert bench.frames[-1].laser


def test_stop_waits_for_no_line():
    """With CTS low neither points nor replies leave; the laser stops all the same."""
    bench = Whole(SMALL, small(12), spots(12), mode=Mode.CONTINUOUS,
                  period_us=SHORT_US)
    bench.run(3 * SHORT_US)
    bench.instrument.clear_to_send(False)
    bench.run(3 * SHORT_US)
    content = bytes([Command.WRITE, 1, REGISTERS["mode"].address, Mode.STOP, 0, 0, 0])
    bench.line.write(frame_packet(content))
    bench.run(2000)
    pulses, shown = len(bench.instrument.pulses), len(bench.shown)
    bench.run(4 * SHORT_US)
    assert len(bench.instrument.pulses) == pulses >= 3 and len(bench.shown) - shown <= 1
    bench.instrument.clear_to_send(True)
    bench.run(4 * SHORT_US)
    assert bench.commands.status()["state"].mode == Mode.STOP
    bench.assert_link_is_clean()
    assert all(frame.balanced and frame.verified for frame in bench.frames)
    assert len(bench.instrument.pulses) == pulses


def test_gaps_between_packets():
    """Three character times of rest between packets, none within, on the serial pin."""
    config = Config()
    bench = Whole(config, any_settings(352, 288, config.beams, 13, report_rejected=False),
                  [spot_frame(352, 288, 13, spots=49)], mode=Mode.CONTINUOUS)
    octets, stamps = bytearray(), []
    for _ in range(400):
        bench.instrument.run(500)
        octets += bench.instrument.receive()
        stamps += list(bench.instrument.stamps)
    bit = round(16e6 / 115_200)
    # Delimiters come in pairs: one closes, the next one opens.
    zeros = [at for at, octet in enumerate(octets) if octet == 0]
    assert len(zeros) > 40
    at = next(at for at in zeros if octets[at + 1] == 0)
    opens = at + 1
    packets = 0
    while True:
        closes = octets.find(0, opens + 1)
        if closes < 0 or closes + 1 >= len(octets):
            break
        assert closes - opens + 1 <= 100
        assert set(np.diff(np.array(stamps[opens:closes + 1], np.int64))) == {10 * bit}
        assert stamps[closes + 1] - (stamps[closes] + 10 * bit) >= 30 * bit
        assert octets[closes + 1] == 0
        opens = closes + 1
        packets += 1
    assert packets > 20
