# amaranth: UnusedElaboratable=no
"""No reader sees a torn frame, whatever the clocks; and what a bank costs."""

from pathlib import Path

import pytest

from hdl.acquisition.frame_memory import FrameMemory
from hdl.export import to_verilog
from tb.acquisition.tb_frame_memory import CLOCKS
from tb.hdlsim import run

WIDTH, HEIGHT = 7, 5
RIG = Path(__file__).with_name("frame_memory_rig.v").read_text()


def play(request, clocks, seed, banks=3, least=1, memory=None, **settings):
    settings = {"frames": 300, "hold": 100, "seed": seed, **settings}
    memory = memory or FrameMemory(WIDTH, HEIGHT, banks)
    run(request, "frame_memory_rig", "tb.acquisition.tb_frame_memory",
        verilog={"frame_memory.v": to_verilog(memory, "frame_memory"), "frame_memory_rig.v": RIG},
        parameters={"clocks": clocks, "settings": settings, "least": least, "banks": banks},
        build_args=["--timing", "--no-sched-zero-delay", "-CFLAGS", "-std=c++20"])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("banks", [2, 3])
@pytest.mark.parametrize("clocks", CLOCKS)
def test_frames_are_whole(request, clocks, banks, seed):
    """Frames back to back or not, faulty or not; readers that hold them for long or not."""
    settings = {"gap": 60, "faulty": 40, "blanking": 20, "idling": 30} if seed == 1 else {
        "reads_along": 1}
    play(request, CLOCKS[clocks], seed, banks, **settings)
