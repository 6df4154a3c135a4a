"""What `make synth-export` writes is legal everywhere, and the design stays small."""

import fcntl
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hdl.config import PRESETS
from hdl.export import LEGAL, SV_RESERVED, VHDL_RESERVED, flat_ports
from hdl.protocol import REMAP, TABLES, tables
from model.preprocessing.remap import OUTSIDE, pack_remap
from model.settings import Settings
from scripts.cyclope import cli
from scripts.paths import ROOT
from scripts.rtl import export, report, size
from scripts.rtl.blocks import ASSEMBLIES, BLOCKS, TOP, VARIANTS, Block, find, present
from scripts.rtl.flows.parts import PARTS
from scripts.rtl.verilog import Memory, Port, memories, modules, ports, verilog
from scripts.simulation.library import ZEROS
from tb.hdlsim import WAIVERS, prepare_environment, require_ghdl

PRESENT = present()
TWINS = [block for block in PRESENT if block.twin]
NAMES = [block.name for block in PRESENT]


@pytest.fixture(scope="session")
def exported():
    """The folder for any tool, made anew in each run by the first worker that wants it."""
    folder = ROOT / "build" / "test" / "export"
    folder.parent.mkdir(parents=True, exist_ok=True)
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID", "")
    with open(folder.with_name(".export.run"), "a+") as made:
        fcntl.flock(made, fcntl.LOCK_EX)
        made.seek(0)
        if not run or made.read() != run:
            made.truncate(0)
            shutil.rmtree(folder, ignore_errors=True)
            export.generic(folder, PRESETS["capsule"])
            made.write(run)
    return folder


def component_of(block):
    """A component to look at, which Amaranth need not warn of since nothing elaborates it."""
    component = block.component()
    component._MustUse__silence = True
    return component


def text_of(exported, block):
    return (exported / "verilog" / f"{block.name}.v").read_text()


def test_every_component_is_listed():
    assert set(PRESENT) == {*BLOCKS, *ASSEMBLIES}


def test_unknown_block_is_refused():
    with pytest.raises(LookupError, match="There is no block 'nonesuch'; there are: .*labelling"):
        find("nonesuch")


def test_block_is_found_by_its_path():
    assert find("hdl/preprocessing/binarise.py") == Block("binarise", "preprocessing")


@pytest.mark.parametrize("block", PRESENT, ids=NAMES)
def test_port_names_are_legal(exported, block):
    found = ports(text_of(exported, block), block.name)
    names = [port.name for port in found]
    assert len({name.lower() for name in names}) == len(names)
    assert block.name not in names
    for name in names:
        assert LEGAL.fullmatch(name), name
        assert name not in VHDL_RESERVED | SV_RESERVED, name
    assert set(flat_ports(component_of(block))) <= set(names)


@pytest.mark.parametrize("block", PRESENT, ids=NAMES)
def test_every_process_hears_something(exported, block):
    """A part of a signal that is driven by a constant becomes one that never runs in a simulator:
    drive such a part together with the rest."""
    assert not re.findall(r"always @\*\n\s+(\S+) *= \d+'s?h[\da-f]+ *;", text_of(exported, block))


@pytest.mark.parametrize("block", PRESENT, ids=NAMES)
def test_tables_name_every_port_and_memory(exported, block):
    text = text_of(exported, block)
    table = (exported / "PORTS.md").read_text()
    section = re.search(rf"^## {block.name}\n(.*?)(?=^## |\Z)", table, re.M | re.S)[1]
    listed = re.findall(r"^\| `(\w+)` \| (\w+) \| (\d+) \|", section, re.M)
    assert sorted(listed) == sorted(
        (port.name, port.direction, str(port.width)) for port in ports(text, block.name))
    held = memories(text)
    assert len(held) == len(re.findall(r"^  reg [^;=]*\[\d+:\d+\];", text, re.M))
    table = (exported / "MEMORIES.md").read_text()
    for memory in held:
        row = f"| {block.name} | `{memory.module}` | `{memory.name}` | {len(memory.words)} |"
        assert row in table
        file = exported / "memory" / memory.file_name
        assert file.exists() == any(memory.words)
        if file.exists():
            comment, *words = file.read_text().splitlines()
            assert comment.startswith(f"// {memory.module}, {memory.name}: ")
            assert [int(word, 16) for word in words] == list(memory.words)


@pytest.mark.parametrize("block", PRESENT, ids=NAMES)
def test_verilog_is_clean(exported, block):
    """Nothing but what Amaranth's way of writing Verilog explains is waived.

    Memories of zeros have a line for each word, half a million in all, which are left out here.
    """
    assert_is_clean(exported.with_name("lint"), block.name, text_of(exported, block))


@pytest.mark.parametrize("block", VARIANTS, ids=[block.name for block in VARIANTS])
def test_variant_verilog_is_clean(block):
    name = re.sub(r"\W+", "_", block.name)
    folder = ROOT / "build" / "test" / "lint"
    assert_is_clean(folder, name, verilog(block.component(), name))


def assert_is_clean(folder, name, text):
    """The Verilog ``text`` of the module ``name``, in a folder that the waivers know."""
    prepare_environment()
    file = folder / "verilog" / f"{name}.v"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(ZEROS.sub("", text))
    answer = subprocess.run(
        ["verilator", "--lint-only", "-Wall", "--top-module", name, WAIVERS,
         Path(__file__).with_name("export.vlt"), file], capture_output=True, text=True)
    assert answer.returncode == 0 and not answer.stderr, answer.stderr


@pytest.mark.parametrize("standard", ["93", "08"])
@pytest.mark.parametrize("block", TWINS, ids=[block.name for block in TWINS])
def test_twin_analyses(block, standard, tmp_path):
    require_ghdl()
    answer = subprocess.run(
        ["ghdl", "-a", f"--std={standard}", "--warn-error", f"--workdir={tmp_path}", block.twin],
        capture_output=True, text=True)
    assert answer.returncode == 0, answer.stdout + answer.stderr


@pytest.mark.parametrize("block", TWINS, ids=[block.name for block in TWINS])
def test_twin_has_the_same_ports(exported, block):
    """Same names, directions and widths; `clk` and `rst`, then the members in their order."""
    text = re.sub(r"--.*", "", block.twin.read_text()).lower()
    header = re.search(rf"entity {block.name} is(.*?)\bend\b", text, re.S)[1]
    generics = block.arguments(PRESETS["capsule"])
    twin = []
    for names, direction, kind, high in re.findall(
            r"(\w+(?:\s*,\s*\w+)*)\s*:\s*(in|out)\s+(\w+)(?:\s*\((.*?)\s+downto\s+0\))?",
            header[header.index("port"):]):
        assert kind == ("std_logic_vector" if high else "std_logic")
        width = eval(high, {}, generics) + 1 if high else 1
        twin += [
            Port(name.strip(), f"{direction}put", width) for name in names.split(",")]
    wanted = ports(text_of(exported, block), block.name)
    clock = [Port("clk", "input", 1), Port("rst", "input", 1)]
    assert set(twin) == {*wanted, *clock}

    def members(names):
        return list(dict.fromkeys(re.sub("_(valid|ready|payload)$", "", name) for name in names))

    assert members(port.name for port in twin) == [
        "clk", "rst", *members(flat_ports(component_of(block)))]
    assert (exported / "vhdl" / block.twin.name).read_bytes() == block.twin.read_bytes()


def test_inner_modules_need_no_escape(exported):
    text = text_of(exported, TOP)
    assert "module \\" not in text
    assert len(modules(text)) > len(BLOCKS) / 2


def test_verilog_is_the_same_each_time():
    """Also where Python orders its sets otherwise, and the port list is in order."""
    code = ("from scripts.rtl.blocks import find; from scripts.rtl.verilog import verilog; "
            "print(verilog(find('camera').component(), 'camera'))")
    texts = {
        subprocess.run(
            [sys.executable, "-c", code], env=os.environ | {"PYTHONHASHSEED": seed}, cwd=ROOT,
            capture_output=True, text=True, check=True).stdout for seed in ("1", "2")}
    [text] = texts
    listed = re.search(r"^module camera\((.*)\);$", text, re.M)[1].split(", ")
    clocks = ["clk", "pixel_clk", "pixel_rst", "rst"]
    assert listed == [*clocks, *flat_ports(component_of(find("camera")))]


def test_list_and_core_name_the_design(exported):
    listed = (exported / "files.f").read_text().split()
    core = (exported / "cyclope.core").read_text()
    assert listed == [f"verilog/{TOP.name}.v"]
    assert all((exported / name).exists() and f"- {name}\n" in core for name in listed)
    assert core.startswith("CAPI=2:\n") and f"toplevel: {TOP.name}" in core
    for file in exported.rglob("*"):
        if file.is_file():
            assert str(ROOT) not in file.read_text(), file


def test_export_fills_a_new_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(export, "present", lambda: (find("binarise"),))
    folder = tmp_path / "export"
    assert export.export(folder, flows=["generic"]) == ([find("binarise")], [])
    assert [path.name for path in tmp_path.iterdir()] == ["export"]


def test_command_keeps_a_folder_that_holds_something(tmp_path):
    (tmp_path / "mine").touch()
    assert cli.main(["export", tmp_path]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_tables_are_what_the_settings_load(tmp_path):
    settings = Settings(
        tangential_1=-1, depth=(1, 2, 3), reciprocal=(4,), radial=(5, 6), line=(7,), window=(8,))
    export.write_tables(tmp_path / "tables", settings)
    texts = {file.stem: file.read_text() for file in (tmp_path / "tables").glob("*.hex")}
    for name, words in settings.tables().items():
        read = re.findall(r"^@(\w+) (\w+)$", texts[name], re.M)
        assert [(int(address, 16), int(word, 16)) for address, word in read] == [
            *enumerate(words)]
    registers = (tmp_path / "tables" / "REGISTERS.md").read_text()
    assert "| `tangential_1` | 262143 |" in registers and "| `area_min` | 2 |" in registers
    assert texts.keys() == {table.name for table in TABLES}


def test_places_are_what_a_calibration_for_paper_loads(tmp_path):
    places = np.random.default_rng(1).permutation(np.arange(20)).tolist()
    settings = Settings(depth=(1, 2), reciprocal=(3,), radial=(4,), line=(5,), window=(6,),
                        remap=(*places, OUTSIDE))
    export.write_tables(tmp_path / "tables", settings)
    written = {file.stem for file in (tmp_path / "tables").glob("*.hex")}
    assert written == {table.name for table in tables("paper")}
    comment, *lines = (tmp_path / "tables" / "remap.hex").read_text().splitlines()
    assert comment.startswith(f"// table {REMAP.number} of TABLE: 6 words, ")
    halves = []
    for number, line in enumerate(lines):
        address, word = (int(text, 16) for text in line.removeprefix("@").split())
        assert address == number and word < 1 << REMAP.bits
        halves += [word & 0xFFFFFFFF, word >> 32]
    assert halves == [*pack_remap(settings.remap), 0]


def test_bad_calibration_is_told_in_a_sentence(tmp_path, capsys):
    (tmp_path / "broken.json").write_text("{}")
    out = tmp_path / "out"
    assert cli.main(["export", out, "--calibration", tmp_path / "broken.json"]) == 2
    assert "broken.json" in capsys.readouterr().err and not out.exists()


def test_payload_fields_are_spelt_out():
    table = export.payloads(component_of(find("binarise")))
    assert table["i_payload"] == (
        "grey 7..0, marker.line_end 8, marker.frame_end 9, marker.broken 10")


def test_memories_are_read_from_verilog():
    [memory] = memories(
        "module a.b(x);\n  reg [5:0] words [2:0];\n  initial begin\n    words[0] = 6'h2a;\n"
        "    words[1] = 6'h00;\n    words[2] = 6'h3f;\n  end\nendmodule\n".replace("a.b", "a_b"))
    assert memory == Memory("a_b", "words", 6, (42, 0, 63))
    assert export.hexadecimal(memory) == (
        "// a_b, words: 3 words of 6 bits, first word first, at power-up\n2a\n00\n3f\n")


def test_tables_of_cells_are_counted():
    cells = {"LUT1": 1, "LUT4": 10, "INV": 2, "RAM16X1D": 3, "RAM16X1S": 4, "SRL16E": 5,
             "FDRE": 6, "FDSE": 7, "MULT18X18": 8, "RAMB16_S36_S36": 9, "MUXCY": 100, "MUXF5": 100}
    counted = size.summarise(cells)
    assert [counted[key] for key in size.COLUMNS] == [1 + 10 + 2 + 6 + 4 + 5, 13, 8, 9]
    assert counted["distributed"] == 10


def test_passed_limits_are_told():
    limit = size.LIMITS["capsule"]
    big = {"lut4": limit["lut4"] + 1, "mult18x18": 14, "ramb16": limit["ramb16"] + 1}
    assert size.over("capsule", big) == [
        f"capsule uses {limit['lut4'] + 1} lut4, more than its limit of {limit['lut4']}",
        f"capsule uses {limit['ramb16'] + 1} ramb16, more than its limit of {limit['ramb16']}"]
    assert size.over("depth", big) == []


def test_synthesis_fault_is_told():
    with pytest.raises(RuntimeError, match="yosys cannot synthesise faulty: .*syntax error"):
        size.measure_verilog("module faulty(;", "faulty")
    for folder in size.BUILD.glob("faulty-*"):
        shutil.rmtree(folder)


@pytest.mark.parametrize("name", sorted(size.LIMITS))
def test_size_is_within_its_limits(name):
    """yosys reads the Verilog as it is exported, and what comes out is small and has no latch."""
    counted = size.measure_verilog(verilog(find(name).component(), name), name)
    assert size.over(name, counted) == []
    assert counted["latches"] == 0
    if name == TOP.name:
        key = f"{name}, capsule, {PRESETS['capsule'].beams} beams", "xc2vp"
        used = {"lut": counted["lut4"], "ff": counted["ff"], "memory": counted["ramb16"],
                "multiplier": counted["mult18x18"]}
        assert report.compare({key: used}, report.read()) == ([], [])


@pytest.mark.parametrize("design", [
    "instrument, paper, 49 beams", "instrument, capsule, 49 beams",
    "instrument, capsule, 361 beams"])
def test_figures_fit_the_xc2vp30(design):
    """Those that `make synth-report` compares with."""
    used = report.read()[design, "xc2vp"]
    assert used.keys() == {"lut", "ff", "multiplier", "memory"}
    assert max(report.shares(used, PARTS["XC2VP30"]).values()) <= 100


def test_a_figure_that_moved_is_told():
    key = "instrument, capsule, 49 beams", "xc2vp"
    before = {key: {"lut": 1000, "memory": 20}}
    assert report.compare({key: {"lut": 1049, "memory": 21}}, before) == ([], [])
    assert report.compare({key: {"lut": 1060, "memory": 22}}, before) == (
        [f"{key[0]} for xc2vp: lut is 1060, it was 1000",
         f"{key[0]} for xc2vp: memory is 22, it was 20"], [])
    assert report.compare({("other", "xc7"): {"lut": 1}}, before) == ([], [("other", "xc7")])


def test_paths_are_relative_to_the_project():
    assert Path(size.BUILD).is_relative_to(ROOT)
