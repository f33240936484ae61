"""Runs a wheel in a root folder with a C library, Python, the wheel and its requirements, and nothing else.

    python packaging/try_bare_root.py wheelhouse/sheetsplat-0.1.0-….whl [PACKAGE ...]

The folder is made of this interpreter, its standard library, and the system libraries that these and manylinux name:
no libpng, no OpenGL, no shell. PACKAGEs are installed beside the wheel, such as lavavu-osmesa for OpenGL in software.
Prints what was tried there, and the libraries of the folder. Needs a package index, and rights to make namespaces.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

# What manylinux lets wheels expect of a system.
_OF_MANYLINUX = (
    "libdl.so.2",
    "libgcc_s.so.1",
    "libpthread.so.0",
    "librt.so.1",
    "libstdc++.so.6",
    "libutil.so.1",
    "libz.so.1",
)
_TRIES = {
    "volume": "ss.render(values, size=(64, 48), backend='cpu').save('a.png')",
    "reference": "ss.render(values, size=(16, 12), backend='reference').save('b.exr')",
    "kernels": "ss.render(ss.fit.nearest(rng.random((200, 3)), rng.random(200)), size=48, backend='cpu').save('c.jpg')",
    "again": "assert ss.Recipe.read('a.png').size == (64, 48)",
    "devices": "print(*(f'{one.backend} {one.platform}: {one.available}' for one in ss.devices()), sep='; ')",
}
_OPENGL = "image = ss.render(values, size=48, backend='gl'); print(image.plan.device)"
_HEAD = """
import numpy as np, sheetsplat as ss
n, rng = np.linspace(-1, 1, 24), np.random.default_rng(1)
values = np.exp(-4 * (n[:, None, None] ** 2 + n[:, None] ** 2 + n**2)).astype(np.float32)
"""


def libraries_of(files: list[Path]) -> set[Path]:
    """Return the shared libraries that files need, by the loader's own word."""
    told = subprocess.run(["ldd", *files], capture_output=True, text=True).stdout
    return {Path(one) for one in re.findall(r"(?:=> |^\s+)(/\S+) \(0x", told, re.M)}


def copy(path: Path, root: Path) -> None:
    """Copy a file, without links, to its place in the root folder."""
    target = root / path.relative_to("/")
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(path, target)


def make_root(root: Path, requirements: list[str]) -> list[str]:
    """Fill the root folder; return the names of its system libraries."""
    for name in ("tmp", "proc", "site"):
        (root / name).mkdir()
    python, library = Path(sys.executable).resolve(), Path(sysconfig.get_path("stdlib"))
    # Tk would bring the libraries of a desktop, libpng among them.
    left_out = shutil.ignore_patterns("__pycache__", "*-packages", "test", "tests", "idlelib", "config-*", "_tkinter*")
    shutil.copytree(library, root / library.relative_to("/"), ignore=left_out, symlinks=True)
    copy(python, root)
    needed = libraries_of([python, *(root / library.relative_to("/") / "lib-dynload").glob("*.so")])
    known = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=True).stdout
    places = dict(re.findall(r"^\s*(\S+) \([^)]*x86-64[^)]*\) => (\S+)", known, re.M))
    needed |= {Path(places[name]) for name in _OF_MANYLINUX if name in places}
    for one in needed | libraries_of(sorted(needed)):
        copy(one, root)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--only-binary=:all:", "--target", root / "site", *requirements], check=True)
    return sorted({one.name for one in needed})


def main() -> None:
    """Make the folder, and run in it."""
    wheel, packages = Path(sys.argv[1]).resolve(), sys.argv[2:]
    tries = _TRIES | ({"opengl": _OPENGL} if packages else {})
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        print("libraries:", *make_root(root, [str(wheel), *packages]), flush=True)
        here = [
            shutil.which("unshare") or "unshare",
            "--map-root-user",
            "--mount",
            "--pid",
            "--fork",
            "--mount-proc",
        ]
        here += [f"--root={root}", "--wd=/tmp", str(Path(sys.executable).resolve())]
        environment = {"PYTHONPATH": "/site", "HOME": "/tmp", "PATH": "/"}
        commands = {name: ["-c", _HEAD + code] for name, code in tries.items()}
        commands["demo"] = ["-m", "sheetsplat", "demo", "--backend", "cpu", "--size", "96", "-o", "demo.png"]
        for name, command in commands.items():
            done = subprocess.run([*here, *command], env=environment, capture_output=True, text=True)
            failed = failed or done.returncode != 0
            text = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
            print(f"{name:<10} {'yes' if done.returncode == 0 else 'NO':<4} {text[-1] if text else ''}", flush=True)
        print("files:", *sorted(f"{one.name} ({one.stat().st_size})" for one in (root / "tmp").iterdir()))
    sys.exit(failed)


if __name__ == "__main__":
    os.environ.pop("PYTHONPATH", None)
    main()
