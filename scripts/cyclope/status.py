"""``cyclope status``: what the chip is, what it does, and all its counters."""

from scripts.cyclope.program import pasteable
from scripts.host.port import add_port_arguments, open_port

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope status`` takes."""
    parser.description = "Ask the chip what it is and does, and print all its counters."
    parser.epilog = ("The exit status is 3 if the chip runs without light, without a sensor or "
                     "with a laser guard that has tripped.")
    parser.add_argument("port", metavar="PORT", help="serial device, such as /dev/ttyUSB0")
    parser.add_argument("--registers", action="store_true", help="print all registers too")
    add_port_arguments(parser)


def main(arguments):
    """Print the state of the chip; gives the exit status."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from scripts.host.chip import REGISTERS
    from scripts.host.owner import PortOwner
    from scripts.host.status import find_faults, status_table
    with PortOwner(lambda: open_port(arguments.port, arguments.baud, arguments.rtscts)) as owner:
        commands = owner.commands()
        identity, status = commands.identify(), commands.status()
        values = {name: commands.read(name) for name in (
            REGISTERS if arguments.registers else ("pattern_as_texture",))}
    console = Console()
    console.print(status_table(identity, status, values["pattern_as_texture"]))
    if arguments.registers:
        table = Table(box=box.SIMPLE, show_header=False, padding=(0, 1), pad_edge=False)
        for name, register in REGISTERS.items():
            table.add_row(name, str(values[name]), register.meaning)
        console.print(table)
    faults = find_faults(status)
    for fault in faults:
        print(pasteable(f"! {fault}"))
    return 3 if faults else 0
