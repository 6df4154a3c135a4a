"""The system run: from a scene through imager, pins, RTL and serial line to points and truth."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from calibration import file
from hdl.config import Config
from hdl.export import to_fast_verilog
from hdl.instrument import Instrument
from model.capsule import Capsule as Model
from model.optics.rigs import RIGS
from scripts.cyclope import cli
from scripts.host.commands import Commands
from scripts.host.decoder import Decoder, Frame, TextureFrame
from scripts.host.loading import load, signed
from scripts.host.rebuild import Rebuilder
from scripts.results.accuracy import compare, load_points, load_truth
from scripts.simulation.emulator import Emulator
from scripts.simulation.instrument import Line
from tb import hdlsim
from tb.system.stimuli import any_settings, spot_frame
from tb.system.whole import same

#: What the flattened netlist gives rise to, though no loop is in it.
_FLATTENED = ("-Wno-CASEOVERLAP", "-Wno-UNOPTFLAT")
PAIRS = 20


@pytest.mark.parametrize("kind,seed", [("mixed", 5)])
def test_pairs_against_truth(kind, seed, tmp_path, prepared):
    """Alternating laser, CIF, 115,200 baud, natively: what ``cyclope receive`` makes of the octets
    is the truth, with the accuracy that is asked of depth at a base of 5 mm."""
    calibration = file.load(prepared[1])
    emulator = Emulator(kind, RIGS["endoscope"], seed, scenes=PAIRS)
    line = Line(emulator.instrument)
    commands = Commands(line, timeout=120)
    load(commands, calibration)
    for name, value in {**calibration.settings.registers(), "mode": 1}.items():
        commands.write(name, signed(name, value))
    line.record.clear()
    while emulator.scene is None or emulator.scene < PAIRS + 2:
        line.read()
    (tmp_path / "link.raw").write_bytes(line.record)
    (tmp_path / "truth.csv").write_text("\n".join(emulator.truth()) + "\n")
    out = tmp_path / "out"
    assert cli.main(["receive", tmp_path / "link.raw", "--calibration", prepared[1],
                     "-o", out]) == 0
    rows = [row.split(",") for row in (out / "frames.csv").read_text().splitlines()[1:]]
    lit = [int(row[0]) for row in rows if row[1] == "pattern" and row[2] == "on"]
    assert len(lit) >= PAIRS
    assert len([row for row in rows if row[1] == "texture"]) >= PAIRS
    found = compare(load_points(out / "points.csv"), load_truth(tmp_path / "truth.csv"), lit)
    assert found.found >= 0.97 and found.wrong <= 0.001 and found.mean <= 0.0012

    # And the model's, to the bit.
    model = Model(calibration.settings, 352, 288, points_max=72)
    decoder = Decoder(Rebuilder(calibration.settings, 352, 288))
    frames = decoder.feed(bytes(line.record))
    assert (decoder.damaged, decoder.lost, decoder.mismatched, decoder.unbalanced) == (0, 0, 0, 0)
    frames = {frame.index: frame for frame in frames}
    for number, (image, _) in enumerate(emulator.shown[:max(frames) + 1]):
        if number in frames:
            assert same(frames[number], model.frame(image)), f"frame {number}"


@pytest.mark.parametrize("seed", [6])
def test_three_pairs_in_cocotb(request, seed, tmp_path):
    """CIF, imager clock a little off half the system's, host and reader bit by bit."""
    config = Config(baud=1_000_000)
    settings = any_settings(352, 288, config.beams, seed, area_min=5, report_rejected=False)
    images = [spot_frame(352, 288, 10 * seed + n, spots=49) for n in range(4)]
    texture = (np.add.outer(np.arange(288), np.arange(352)) % 256).astype(np.uint8)
    case, answer, picture = (tmp_path / name for name in ("case", "answer", "picture.hex"))
    picture.touch()
    case.write_bytes(pickle.dumps({
        "settings": settings, "width": 352, "height": 288, "beams": config.beams, "pairs": 4,
        "images": images, "texture": texture, "picture": str(picture), "line_blanking": 3}))
    rig = (Path(__file__).parent / "instrument_rig.v").read_text()
    hdlsim.run(
        request, "instrument_rig", "tb.system.tb_instrument",
        verilog={"instrument_rig.v": rig.replace("DIVISOR = 139", "DIVISOR = 16").replace(
            "PIXEL_HALF_PS = 62500", "PIXEL_HALF_PS = 62611"),
            "instrument.v": to_fast_verilog(Instrument(config), "instrument")},
        build_args=("--timing", *_FLATTENED),
        plusargs=[f"+picture={picture}"],
        parameters={"case": str(case), "answer": str(answer)})
    got = pickle.loads(answer.read_bytes())
    decoder = Decoder(Rebuilder(settings, 352, 288))
    events = decoder.events(got["octets"])
    assert (decoder.damaged, decoder.lost, decoder.mismatched, decoder.unbalanced) == (0, 0, 0, 0)
    frames = {event.index: event for event in events if isinstance(event, Frame)}
    model = Model(settings, 352, 288, points_max=72)
    for number, (image, integrated_us, lit_us) in enumerate(got["shown"][:max(frames) + 1]):
        if integrated_us < 3000:
            assert same(frames[number], model.frame(image)), f"frame {number}"
            assert frames[number].laser == (lit_us > 0)
    assert sum(frame.laser for frame in frames.values()) >= 4
    assert sum(isinstance(event, TextureFrame) for event in events) >= 3
    assert got["pulses"] >= 4 and got["longest"] <= 16_000 + 8 and got["closest"] >= 320_000
