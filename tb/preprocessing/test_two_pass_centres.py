# amaranth: UnusedElaboratable=no
"""From mask to centres as in the preset paper: two-pass labelling, spot queue, centring."""

import numpy as np
import pytest
from amaranth import Module
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from calibration.reciprocal import reciprocal_table
from hdl.payloads import Centre, MaskPixel
from hdl.preprocessing.centre import Centring
from hdl.preprocessing.spot_queue import SpotQueue
from model.preprocessing.area import area_code
from model.preprocessing.centre import centres
from model.preprocessing.spot_queue import filter_spots
from model.preprocessing.two_pass_labelling import label_in_two_passes
from model.settings import Settings
from tb.native_block import NativeBlock
from tb.preprocessing.frames import mask_words
from tb.preprocessing.labelling_images import directed, noise
from tb.preprocessing.two_pass_rig import TwoPassRig

SIZE, LABELS = (64, 64), 2047
#: Clocks that a spot takes at most in the centring block.
INTERVAL = 21


class Centres(wiring.Component):
    """Mask pixels to centres, the labels in a memory outside, 1/N in one inside."""

    def __init__(self, interval):
        self.interval = interval
        super().__init__({
            "i": In(stream.Signature(MaskPixel)), "o": Out(stream.Signature(Centre)),
            "area_min": In(10), "area_max": In(10), "report_rejected": In(1),
            "spots": Out(32), "rejected": Out(32), "dropped": Out(32),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.rig = rig = TwoPassRig(*SIZE[::-1], LABELS, interval=self.interval)
        m.submodules.queue = queue = SpotQueue(16)
        m.submodules.centring = centring = Centring()
        m.submodules.table = table = Memory(shape=36, depth=256, init=reciprocal_table())
        read = table.read_port()
        connect(m, flipped(self.i), rig.i)
        connect(m, rig.o, queue.i)
        connect(m, queue.o, centring.i)
        connect(m, centring.o, flipped(self.o))
        m.d.comb += [
            read.addr.eq(centring.table_address), centring.table_data.eq(read.data),
            queue.counts.ready.eq(1),
            *(getattr(queue, name).eq(getattr(self, name))
              for name in ("area_min", "area_max", "report_rejected")),
        ]
        with m.If(queue.counts.valid):
            for name in ("spots", "rejected", "dropped"):
                total = getattr(self, name)
                m.d.sync += total.eq(total + queue.counts.p[name])
        return m


@pytest.mark.parametrize("report_rejected", [False, True])
@pytest.mark.parametrize("interval", [1, INTERVAL])
def test_centres(interval, report_rejected):
    """Every centre is the model's; a queue of 16 drops none if spots come one by one."""
    rng = np.random.default_rng(1)
    masks = {**directed(*SIZE), **noise(*SIZE, seed=1)}
    names = [name for name in masks if interval > 1 or "noise" not in name]
    lit = np.array([masks[name] for name in names])
    core = lit & (rng.random(lit.shape) < 0.3)
    settings = Settings(area_min=2, area_max=200, report_rejected=report_rejected)
    dut = NativeBlock(Centres(interval))
    dut.set(area_min=2, area_max=200, report_rejected=int(report_rejected))
    dut.reset()
    out = dut.stream(mask_words(lit, core, 0 * lit).reshape(-1, 1), idle=20_000)
    got = out.fields(Centre)
    frames = np.split(got, np.flatnonzero(got["end"]) + 1)[:-1]
    assert len(frames) == len(lit)

    totals = dict.fromkeys(("spots", "rejected", "dropped"), 0)
    missing = 0
    for name, mask, cores, found in zip(names, lit, core, frames, strict=True):
        spots, dropped = label_in_two_passes(mask, cores, LABELS)
        queued, counts = filter_spots(spots, settings)
        u, v = centres(queued, reciprocal_table())
        want = list(zip(queued["rejected"].tolist(), area_code(queued["area"]).tolist(),
                        u.tolist(), v.tolist(), strict=True))
        have = [(bool(spot["rejected"]), spot["area"], spot["u"], spot["v"])
                for spot in found[:-1]]
        assert dropped == 0
        for key in totals:
            totals[key] += counts[key]
        if interval == INTERVAL:
            assert have == want, name
        else:
            rest = iter(want)
            assert all(spot in rest for spot in have), name
            missing += len(want) - len(have)
    assert dut.get("spots") == totals["spots"]
    if interval == INTERVAL:
        assert dut.get("rejected") == totals["rejected"] and dut.get("dropped") == 0
    else:
        assert dut.get("dropped") + dut.get("rejected") - totals["rejected"] == missing > 0


def test_centre_of_a_spot_in_pixels():
    """A disc's centre, in pixels: the mean of its pixels, to half an LSB of Q9.9 and the table."""
    v, u = np.mgrid[:SIZE[0], :SIZE[1]]
    lit = np.array([np.hypot(u - x, v - y) < r for x, y, r in [
        (10.3, 20.8, 2.4), (33.5, 31.5, 4.0), (60.1, 3.7, 3.3), (31.0, 50.0, 8.9)]])
    dut = NativeBlock(Centres(INTERVAL))
    dut.set(area_min=1, area_max=1023, report_rejected=0)
    dut.reset()
    got = dut.stream(mask_words(lit, lit, 0 * lit).reshape(-1, 1), idle=20_000).fields(Centre)
    got = got[got["end"] == 0]
    for mask, spot in zip(lit, got, strict=True):
        assert spot["area"] == mask.sum()
        assert abs(spot["u"] / 512 - u[mask].mean()) < 0.0032
        assert abs(spot["v"] / 512 - v[mask].mean()) < 0.0032
