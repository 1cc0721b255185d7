"""The shared libraries that the wheels expect from the system, and Debian's names for them.

Prints what is missing, on one line: Debian packages, or with ``--libraries`` the libraries' names.
Runs before anything is installed, so it needs nothing but the standard library.
"""

import ctypes
import shutil
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path

LIBRARIES = {  # what libOpen3D.so of Open3D 0.20 is linked to beyond glibc: Debian's package
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgcc_s.so.1": "libgcc-s1",
    "libidn2.so.0": "libidn2-0",
    "libstdc++.so.6": "libstdc++6",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}


def loads(library: str, load: Callable[[str], object] = ctypes.CDLL) -> bool:
    """Whether the dynamic linker finds and loads the library."""
    try:
        load(library)
    except OSError:
        return False
    return True


def missing_libraries(load: Callable[[str], object] = ctypes.CDLL) -> dict[str, str]:
    """Libraries that do not load, each with its package; none where wheels bundle them."""
    if sys.platform != "linux":
        return {}
    return {name: package for name, package in LIBRARIES.items() if not loads(name, load)}


def missing_build_tools(version: tuple[int, int]) -> dict[str, str]:
    """What compiling immutables needs, which has no wheel for Python 3.14."""
    if version < (3, 14):
        return {}
    header = Path(sysconfig.get_path("include"), "Python.h")
    tools = {"Python.h": f"python{version[0]}.{version[1]}-dev"} if not header.exists() else {}
    return tools | ({} if shutil.which("cc") else {"cc": "gcc", "libc.so": "libc6-dev"})


def main() -> None:
    """Print the names, separated by spaces; nothing at all when nothing is missing."""
    missing = missing_libraries() | missing_build_tools(sys.version_info[:2])
    names = missing if "--libraries" in sys.argv else missing.values()
    sys.stdout.write(" ".join(sorted(set(names))))


if __name__ == "__main__":
    main()
