"""``cyclope status``: what the chip is, what it does, and all its counters."""

from scripts.host.chip import Commands
from scripts.host.port import add_port_arguments, open_port
from scripts.host.status import status_table

__all__ = ["add_arguments", "main"]


def add_arguments(parser):
    """Declare what ``cyclope status`` takes."""
    parser.description = "Ask the chip what it is and does, and print all its counters."
    parser.add_argument("port", metavar="PORT", help="serial device, such as /dev/ttyUSB0")
    parser.add_argument("--registers", action="store_true", help="print all registers too")
    add_port_arguments(parser)


def main(arguments):
    """Print the state of the chip; gives the exit status."""
    from rich.console import Console
    console = Console()
    with open_port(arguments.port, arguments.baud, arguments.rtscts) as port:
        commands = Commands(port)
        console.print(status_table(
            commands.identify(), commands.status(), commands.read("pattern_as_texture")))
        if arguments.registers:
            from rich import box
            from rich.table import Table

            from scripts.host.chip import REGISTERS
            table = Table(box=box.SIMPLE, show_header=False, padding=(0, 1), pad_edge=False)
            for name, register in REGISTERS.items():
                table.add_row(name, str(commands.read(name)), register.meaning)
            console.print(table)
    return 0
