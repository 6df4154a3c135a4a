# amaranth: UnusedElaboratable=no
"""The folders of `make synth-export` for vendors' tools, checked without these tools."""

import json
import os
import re
import shutil
import subprocess
import sys
from functools import cache

import pytest
from amaranth.hdl import Signal

from hdl.config import Config
from hdl.instrument import Instrument
from model.errors import UserError
from scripts.cyclope import cli
from scripts.paths import ROOT, locked
from scripts.rtl import export
from scripts.rtl.blocks import TOP, find
from scripts.rtl.crossings import crossings
from scripts.rtl.flows.make import choose, prepare
from scripts.rtl.flows.parts import BOARDS, PARTS, boards_of
from scripts.rtl.netlist import netlist
from scripts.rtl.synthesis import FAMILIES, synthesise
from scripts.rtl.verilog import verilog
from scripts.simulation.library import ZEROS
from tb.hdlsim import WAIVERS, prepare_environment

SMALL = {preset: choose(preset, (64, 64), 16) for preset in ("capsule", "paper")}
CASES = [("xilinx-ise", "capsule"), ("xilinx-vivado", "capsule"), ("libero", "capsule"),
         ("lattice-ecp5", "capsule"), ("xilinx-ise", "paper"), ("xilinx-vivado", "paper")]
PAIRS = [(flow, preset, board) for flow, preset in CASES for board in BOARDS[flow]]
NAMES = [f"{board.name}-{preset}" for _, preset, board in PAIRS]
#: Cells of the vendors that the tops name, with the ports that they connect.
CELLS = {
    "BUFG": "input I, output O", "IBUFG": "input I, output O", "CLKINT": "input A, output Y",
    "OFS1P3DX": "input D, SP, SCLK, CD, output Q",
    "DCM": "input CLKIN, CLKFB, RST, PSEN, PSINCDEC, PSCLK, DSSEN, output CLK0, CLKFX, CLKDV, "
           "LOCKED, CLK90, CLK180, CLK270, CLK2X, CLK2X180, CLKFX180, PSDONE, "
           "output [7:0] STATUS",
    "MMCME2_BASE": "input CLKIN1, CLKFBIN, RST, PWRDWN, output CLKFBOUT, CLKOUT0, CLKOUT1, LOCKED, "
                   "CLKFBOUTB, CLKOUT0B, CLKOUT1B, CLKOUT2, CLKOUT2B, CLKOUT3, CLKOUT3B, CLKOUT4, "
                   "CLKOUT5, CLKOUT6",
    "EHXPLLL": "input CLKI, CLKFB, RST, STDBY, PHASESEL0, PHASESEL1, PHASEDIR, PHASESTEP, "
               "PHASELOADREG, PLLWAKESYNC, ENCLKOP, output CLKOP, CLKOS, LOCK",
}


def few(text, top, family):
    """Resources that every part has."""
    return dict.fromkeys(FAMILIES[family].costs, 0)


@cache
def written(flow, preset):
    """The folder of a flow, written once for all workers of a run."""
    folder = ROOT / "build" / "test" / "flows" / f"{flow}-{preset}"
    run, done = os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid())), folder.with_suffix(
        ".run")
    with locked(folder):
        if not done.exists() or done.read_text() != run:
            shutil.rmtree(folder, ignore_errors=True)
            prepare(flow, SMALL[preset], count=few).write(folder)
            done.write_text(run)
    return folder


@cache
def paths_of(preset):
    """Paths between clocks of the design, from its netlist, and nothing of the exporter's."""
    pins = {"frame_valid": "pixel_clk", "line_valid": "pixel_clk", "data": "pixel_clk",
            "rx": None, "cts": None}
    return crossings(netlist(Instrument(SMALL[preset])), pins=pins)


def active(text):
    """Lines of constraints that are not comments."""
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


@pytest.mark.parametrize("flow,preset,board", PAIRS, ids=NAMES)
def test_every_clock_and_crossing_has_its_constraint(flow, preset, board):
    folder = written(flow, preset)
    suffix = {"xilinx-ise": "ucf", "xilinx-vivado": "xdc", "libero": "sdc", "lattice-ecp5": "lpf"}
    lines = active((folder / f"{board.name}.{suffix[flow]}").read_text())
    found = paths_of(preset)
    assert len(found) > 7
    clocks = {one.destination_clock for one in found}
    if flow == "lattice-ecp5":
        checks = (folder / "check_timing.py").read_text()
    for clock in clocks:
        if flow == "lattice-ecp5":
            assert f"'{clock}': " in checks
        else:
            assert any(re.search(rf"(-name \{{?|PERIOD \"){clock}\b", line) for line in lines)
    for one in found:
        pair = one.source_clock, one.destination_clock
        if flow == "lattice-ecp5":
            assert pair[0] == "no clock" or f"{pair}: " in checks
            continue
        if pair[0] != "no clock":
            bound = {"ucf": f'FROM "{pair[0]}" TO "{pair[1]}"'}.get(suffix[flow])
            assert any(bound in line if bound else "set_max_delay" in line and re.search(
                rf"-from .get_clocks .{pair[0]}.. -to .get_clocks .{pair[1]}..", line)
                for line in lines), pair
        if not one.destination.endswith("_r_data"):
            cells = {net.replace("$", "_").replace(".", "/") for net in one.destination_nets}
            assert any(re.search(rf"core/{cell}\b|core/{cell}_", line)
                       for cell in cells for line in lines), one.destination


@pytest.mark.parametrize("flow,preset,board", PAIRS, ids=NAMES)
def test_every_pin_has_a_line_and_no_site_is_used_twice(flow, preset, board):
    folder = written(flow, preset)
    suffix = {"xilinx-ise": "ucf", "xilinx-vivado": "xdc", "libero": "pdc", "lattice-ecp5": "lpf"}
    text = (folder / f"{board.name}.{suffix[flow]}").read_text()
    header = re.search(r"^module .*?\);", (folder / "rtl" / f"{board.name}.v").read_text(),
                       re.M | re.S)[0]
    pins = re.findall(r"(?:input|output|inout) (\[\d+:0\] )?(\w+)", header)
    assert {"clock_in", "reset_in", "laser", "rx", "tx"} <= {pin for _, pin in pins}
    for _, pin in pins:
        site = "(LOC|PACKAGE_PIN|SITE|-pinname)"
        assert re.search(rf"{site}.*\b{pin}\b|\b{pin}\b.*{site}", text), pin
    placed = re.findall(r"(?:LOC = |PACKAGE_PIN |SITE |-pinname )\"?(\w+)", "\n".join(active(text)))
    assert len(placed) == len(set(placed)) and "SITE" not in placed


def test_synchronisers_and_guard_are_marked():
    text = (written("xilinx-ise", "capsule") / "rtl" / f"{TOP.name}.v").read_text()
    marked = re.findall(r"\(\* (.*?) \*\)\n  reg (?:\[\d+:0\] )?(\w+)", text)
    stages = [name for attributes, name in marked
              if 'SHREG_EXTRACT = "NO"' in attributes and 'ASYNC_REG = "TRUE"' in attributes]
    assert sorted(stages) == ["stage0"] * 6 + ["stage1"] * 6
    kept = {name for attributes, name in marked if 'DONT_TOUCH = "TRUE"' in attributes}
    assert {"flags", "flags_parity", "length", "spent", "since", "token", "silence"} <= kept


class Stray(Instrument):
    """With a path from the system's clock to the imager's, without a synchroniser."""

    def elaborate(self, platform):
        m = super().elaborate(platform)
        stray, taken = Signal(), Signal()
        m.d.sync += stray.eq(self.rx)
        m.d.pixel += taken.eq(stray)
        m.d.comb += m.submodules.sequencer.capture.eq(taken)
        return m


def test_a_crossing_that_is_not_in_the_table_is_refused():
    with pytest.raises(UserError, match=r"not in the table of safe ones .*\(clk\) -> "
                                        r"taken \(pixel_clk\)"):
        prepare("xilinx-ise", SMALL["capsule"], make=Stray, count=few)


def test_what_fits_no_part_is_refused_with_the_numbers(tmp_path, capsys, monkeypatch):
    def many(text, top, family):
        return few(text, top, family) | {"memory": 120, "multiplier": 55}

    monkeypatch.setattr(export.export, "__defaults__", tuple(
        many if value is synthesise else value for value in export.export.__defaults__))
    out = tmp_path / "out"
    size = ["--size", "64x64", "--beams", "16"]
    assert cli.main(["export", out, "--flow", "libero", *size]) == 2
    said = capsys.readouterr().err
    assert "M2GL025 is too small: 55 MACC are needed and it has 34; 120 LSRAM are needed" in said
    assert "A3PE3000 is too small" in said and not out.exists()
    assert list(tmp_path.iterdir()) == []
    assert cli.main(["export", out, "--flow", "xilinx-vivado", "--flow", "nonesuch", *size]) == 2
    assert "There is no flow 'nonesuch'; there are generic, " in capsys.readouterr().err
    assert cli.main(["export", out, "--part", "XC7A35T", *size]) == 2
    assert "XC7A35T is too small: 120 RAMB36 are needed and it has 50" in capsys.readouterr().err
    assert cli.main(["export", out, "--size", "12"]) == 2
    assert "--size must be two numbers" in capsys.readouterr().err
    assert cli.main(["export", out, "--beams", "9999"]) == 2
    assert "beams must be an integer from" in capsys.readouterr().err and not out.exists()


def test_parts_that_are_too_small_are_left_out_and_named(tmp_path, monkeypatch):
    def some(text, top, family):
        return few(text, top, family) | {"memory": 60}

    monkeypatch.setattr(export, "present", lambda: (find("binarise"),))
    _, left_out = export.export(tmp_path / "out", SMALL["capsule"], ["lattice-ecp5"], count=some)
    assert left_out == ["LFE5U-25F is too small: 60 DP16KD are needed and it has 56"]
    folder = tmp_path / "out" / "lattice-ecp5"
    assert not (folder / "ulx3s_25.mk").exists() and (folder / "ulx3s_45.mk").exists()
    assert left_out[0] in (folder / "README.md").read_text()


#: Notes every command that is not Tcl's own, and gives back something with each.
_UNKNOWN = """
set called {}
proc unknown {args} { global called; lappend called $args; return [lindex $args end] }
"""


@pytest.mark.parametrize("flow,preset", CASES)
def test_scripts_of_tcl_run_and_their_files_are_there(flow, preset):
    tkinter = pytest.importorskip("tkinter", reason="this Python has no tkinter, so no Tcl")
    folder = written(flow, preset)
    scripts = sorted(folder.glob("*.tcl"))
    assert bool(scripts) == (flow != "lattice-ecp5")
    for script in scripts:
        tcl = tkinter.Tcl()
        tcl.eval(_UNKNOWN)
        tcl.eval(f"cd {{{folder}}}; info script {{{script}}}")
        tcl.eval(script.read_text())
        called = [tcl.splitlist(line) for line in tcl.splitlist(tcl.eval("set called"))]
        names = {word for line in called for words in line for word in words.split()
                 if re.search(r"\.(v|vhd|xdc|ucf|sdc|pdc|ndc)$", word)
                 and "constraint" not in word and line[0] != "organize_tool_files"}
        assert any(name.endswith(f"{TOP.name}.v") for name in names)
        assert len(names) >= 3
        for name in names:
            assert (folder / name).exists(), name
    for file in [*folder.glob("*.xdc"), *folder.glob("*.[spn]dc")]:
        tcl = tkinter.Tcl()
        tcl.eval(_UNKNOWN)
        tcl.eval(file.read_text())
        assert {tcl.splitlist(line)[0] for line in tcl.splitlist(tcl.eval("set called"))} <= {
            "create_clock", "create_generated_clock", "get_cells", "get_clocks", "get_pins",
            "get_ports", "set_false_path", "set_input_delay", "set_output_delay", "set_max_delay",
            "set_property", "set_io", "set_ioff"}


def test_shell_and_make_files_are_understood():
    ise, ecp5 = written("xilinx-ise", "capsule"), written("lattice-ecp5", "capsule")
    subprocess.run(["sh", "-n", "build.sh"], cwd=ise, check=True)
    listed = re.findall(r'^verilog work "(.*)"$', (ise / "xup_v2p.prj").read_text(), re.M)
    assert listed == ["rtl/instrument.v", "rtl/xup_v2p.v"]
    assert all((ise / name).exists() for name in listed)
    for board in boards_of("lattice-ecp5"):
        shown = subprocess.run(["make", "-n", "-f", f"{board.name}.mk"], cwd=ecp5, check=True,
                               capture_output=True, text=True).stdout
        assert f"rtl/instrument.v rtl/{board.name}.v" in shown and "ecppack" in shown
    compile((ecp5 / "check_timing.py").read_text(), "check_timing.py", "exec")


def test_a_report_is_held_against_the_bounds(tmp_path):
    script = written("lattice-ecp5", "capsule") / "check_timing.py"
    good = {"fmax": {"$glbnet$clk": {"achieved": 40.0},
                     "$glbnet$pixel_clk$TRELLIS_IO_IN": {"achieved": 90.0}},
            "critical_paths": [
                {"from": f"posedge $glbnet${a}", "to": f"posedge $glbnet${b}",
                 "path": [{"delay": 1.0}, {"delay": 2.5}]}
                for a, b in (("clk", "pixel_clock"), ("pixel_clock", "clk"))]}

    def run(report):
        (tmp_path / "report.json").write_text(json.dumps(report))
        return subprocess.run([sys.executable, script, tmp_path / "report.json"],
                              capture_output=True, text=True)

    assert run(good).returncode == 0
    slow = run(good | {"fmax": good["fmax"] | {"$glbnet$clk": {"achieved": 12.0}}})
    assert slow.returncode == 1 and "clk: 12.00 MHz, at least 16.00: MISSED" in slow.stdout
    paths = [good["critical_paths"][0], good["critical_paths"][1] | {"path": [{"delay": 70.0}]}]
    late = run(good | {"critical_paths": paths})
    assert late.returncode == 1 and "pixel_clk -> clk: 70.00 ns" in late.stdout
    missing = run(good | {"critical_paths": paths[:1]})
    assert missing.returncode == 1 and "not in the report" in missing.stdout


def stubs(folder):
    """A file with the vendors' cells, which take any parameter."""
    file = folder / "cells.v"
    file.parent.mkdir(parents=True, exist_ok=True)
    parameters = {
        "DCM": "CLKIN_PERIOD CLK_FEEDBACK CLKDV_DIVIDE CLKFX_MULTIPLY CLKFX_DIVIDE "
               "DLL_FREQUENCY_MODE DFS_FREQUENCY_MODE",
        "MMCME2_BASE": "CLKIN1_PERIOD DIVCLK_DIVIDE CLKFBOUT_MULT_F CLKOUT0_DIVIDE_F "
                       "CLKOUT1_DIVIDE",
        "EHXPLLL": "PLLRST_ENA INTFB_WAKE STDBY_ENABLE DPHASE_SOURCE OUTDIVIDER_MUXA "
                   "OUTDIVIDER_MUXB OUTDIVIDER_MUXC OUTDIVIDER_MUXD FEEDBK_PATH CLKI_DIV CLKFB_DIV "
                   "CLKOP_ENABLE CLKOP_DIV CLKOP_CPHASE CLKOP_FPHASE CLKOS_ENABLE CLKOS_DIV "
                   "CLKOS_CPHASE CLKOS_FPHASE"}
    file.write_text("/* verilator lint_off DECLFILENAME */\n"
                    "/* verilator lint_off UNUSEDSIGNAL */\n/* verilator lint_off UNDRIVEN */\n"
                    "/* verilator lint_off UNUSEDPARAM */\n" + "".join(
        f"module {name} " + ("#(" + ", ".join(f"parameter {one} = 0" for one in parameters[
            name].split()) + ") " if name in parameters else "") + f"({pins}); endmodule\n"
        for name, pins in CELLS.items()))
    return file


@pytest.mark.parametrize("flow,preset,board", PAIRS, ids=NAMES)
def test_tops_are_clean(flow, preset, board):
    """Verilator finds nothing in a top, with the design and the vendors' cells around it."""
    prepare_environment()
    folder = ROOT / "build" / "test" / "flows" / f"lint-{flow}-{preset}-{board.name}" / "verilog"
    folder.mkdir(parents=True, exist_ok=True)
    core = folder / f"{TOP.name}.v"
    core.write_text(ZEROS.sub("", (written(flow, preset) / "rtl" / core.name).read_text()))
    answer = subprocess.run(
        ["verilator", "--lint-only", "-Wall", "--top-module", board.name, WAIVERS,
         ROOT / "tb" / "system" / "export.vlt", core,
         written(flow, preset) / "rtl" / f"{board.name}.v", stubs(folder.parent)],
        capture_output=True, text=True)
    assert answer.returncode == 0 and not answer.stderr, answer.stderr


def test_icarus_compiles_the_design_and_a_top(tmp_path):
    if shutil.which("iverilog") is None:
        pytest.skip("Icarus is not installed: `apt-get install iverilog` to compile the exports")
    folder = written("xilinx-ise", "capsule")
    answer = subprocess.run(
        ["iverilog", "-g2001", "-Wall", "-Wno-timescale", "-o", tmp_path / "design",
         "-s", "xup_v2p",
         folder / "rtl" / "instrument.v", folder / "rtl" / "xup_v2p.v", stubs(tmp_path)],
        capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr


#: A block with a queue between clocks, and one with multipliers and a table.
_BLOCKS = ("camera", "undistort")


@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "xc2vp"])
def test_yosys_synthesises_for_every_family(family):
    """Whole designs are for `make synth-report`."""
    used = {name: synthesise(text_of_block(name), name, family) for name in _BLOCKS}
    assert all(one["lut"] and one["ff"] for one in used.values())
    assert used["undistort"]["memory"] >= 1
    if family != "proasic3e":
        assert used["undistort"]["multiplier"] >= 1


@cache
def text_of_block(name):
    return verilog(find(name).component(Config(width=64, height=64, beams=16)), name)


def test_a_latch_or_a_second_driver_is_an_error():
    latch = ("module faulty(input a, input b, output reg q); always @* if (a) q = b; endmodule")
    with pytest.raises(RuntimeError, match="latch"):
        synthesise(latch, "faulty", "xc7")
    second = ("module faulty(input clk, input a, output q); reg r, s; "
              "always @(posedge clk) begin r <= a; s <= ~a; end assign q = r; assign q = s; "
              "endmodule")
    with pytest.raises(RuntimeError, match="cannot synthesise faulty"):
        synthesise(second, "faulty", "xc7")


def test_parts_know_their_families():
    assert {part.family for part in PARTS.values()} <= FAMILIES.keys()
    for flow in BOARDS:
        for board in BOARDS[flow]:
            assert board.part in PARTS
            assert set(PARTS[board.part].capacity) == set(FAMILIES[PARTS[board.part].family].costs)
