"""The instrument as golden models: commands and octets as the chip's, read by the same reader."""

import numpy as np
import pytest

from hdl.protocol import GUARD_CAUSES, Mode
from model.capsule import Capsule
from model.optics.rigs import RIGS
from scripts.host.commands import Commands
from scripts.host.decoder import Decoder
from scripts.host.load_plan import LoadPlan
from scripts.host.loading import signed
from scripts.host.messages import Frame, TextureFrame, TexturePiece
from scripts.host.rebuild import Rebuilder
from scripts.simulation.live_scene import POSES, LiveScene, moving_polyp
from scripts.simulation.model_instrument import ModelInstrument
from tb.system.fake_instrument import any_calibration, images

TEXTURE = np.random.default_rng(1).integers(0, 256, (64, 64), np.uint8)


class Line:
    """The host's end of its line, without time of its own."""

    name = "the model"

    def __init__(self, instrument):
        self.instrument, self.record = instrument, b""

    def write(self, octets):
        self.instrument.send(octets)

    def read(self):
        self.instrument.run(5000)
        octets = self.instrument.receive()
        self.record += octets
        return octets


@pytest.fixture
def bench():
    """A line to an instrument that shows images in turn, those that were shown, the calibration."""
    calibration, shown, lit = any_calibration(rows=4, columns=4), [], []

    def expose(pattern_us, texture_us, light):
        shown.append(images()[len(shown) % 8])
        lit.append((light, pattern_us, texture_us))
        return shown[-1], TEXTURE

    line = Line(ModelInstrument(expose, 64, 64, 16, baud=1_000_000))
    return line, shown, lit, calibration


def load(line, calibration, mode=Mode.CONTINUOUS, **registers):
    values = {name: signed(name, value)
              for name, value in calibration.settings.registers().items()}
    plan = LoadPlan(calibration, values | registers, mode, 0, False, None)
    commands = Commands(line)
    plan.check(commands)
    plan.carry_out(commands)
    return commands, plan.settle(commands)


def test_points_are_those_of_the_model(bench):
    line, shown, lit, calibration = bench
    commands, status = load(line, calibration, pattern_us=400)
    assert status["state"].armed and status["state"].mode == Mode.CONTINUOUS
    for _ in range(80):
        line.read()
    assert commands.status()["pairs"] == len(shown) > 8
    assert all(each == (True, 400, 10_000) for each in lit)
    events = Decoder(Rebuilder(calibration.settings, 64, 64)).events(line.record)
    frames = [event for event in events if isinstance(event, Frame)]
    model = Capsule(calibration.settings, 64, 64, points_max=72)
    for frame, image in zip(frames, shown, strict=True):
        seen = model.frame(image)
        ok = seen.points["status"] == 0
        assert frame.complete and frame.laser and frame.tables_valid and frame.exposure_us == 400
        assert frame.verified or not ok.any()
        for name in ("beam", "u", "v", "inverse_z", "area"):
            got = frame.points[name][frame.points["status"] == 0]
            assert np.array_equal(got, seen.points[name][ok]), name
    assert [frame.index for frame in frames] == list(range(0, 2 * len(frames), 2))
    times = np.diff([frame.timestamp_us for frame in frames])
    assert (times == 40_000).all()
    whole = np.zeros((64, 64), bool)
    for event in events:
        if isinstance(event, TexturePiece):
            end = event.column + len(event.pixels)
            error = event.pixels - TEXTURE[event.row, event.column:end].astype(int)
            assert np.abs(error).max() <= 2
            whole[event.row, event.column:end] = True
    assert whole.all()
    assert all(not event.laser for event in events if isinstance(event, TextureFrame))


def test_no_light_without_tables_nor_after_a_trip(bench):
    line, _, lit, calibration = bench
    commands = Commands(line)
    commands.write("mode", Mode.CONTINUOUS)
    for _ in range(20):
        line.read()
    assert lit and not any(light for light, *_ in lit)
    load(line, calibration)
    assert lit[-1][0]
    line.instrument.tripped = 1 << GUARD_CAUSES.index("duty")
    for _ in range(20):
        line.read()
    assert not lit[-1][0] and commands.status()["guard_causes"] == line.instrument.tripped
    commands.clear()
    for _ in range(20):
        line.read()
    assert lit[-1][0] and commands.status()["guard_causes"] == 0


def test_stop_and_single(bench):
    line, shown, _, calibration = bench
    commands, _ = load(line, calibration, mode=Mode.STOP)
    assert not shown
    commands.write("mode", Mode.SINGLE)
    for _ in range(40):
        line.read()
    assert len(shown) == 1 and commands.status()["state"].mode == Mode.STOP


def test_a_moving_polyp_stays_in_range():
    rig = RIGS["endoscope"]
    poses = moving_polyp(rig)
    assert len(poses) == POSES
    distances = np.array([pose.wall.distance_mm for pose in poses])
    assert rig.range_mm[0] < distances.min() and distances.max() < rig.range_mm[1]
    assert 0 < np.abs(np.diff(distances)).max() < 1
    scene = LiveScene("plane", RIGS["small"])
    pattern, texture = scene.expose(500, 10_000, True)
    dark, _ = scene.expose(500, 10_000, False)
    assert pattern.shape == texture.shape == (64, 64) and pattern.max() > dark.max() + 30
