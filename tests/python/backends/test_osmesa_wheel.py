"""The libOSMesa of the wheel lavavu-osmesa is found beside the package where the system has none."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sheetsplat as ss
from sheetsplat import _sheetsplat

CODE = """
import json, sys
sys.meta_path[:] = [one for one in sys.meta_path if "_editable" not in type(one).__module__]
sys.path.insert(0, sys.argv[1])
import sheetsplat
assert sheetsplat.__file__.startswith(sys.argv[1])
print(json.dumps([(d.platform, d.available, d.description) for d in sheetsplat.devices() if d.platform == "osmesa"]))
"""


@pytest.fixture
def packages(tmp_path):
    """A folder of packages that holds a copy of this one, and a search path on which libOSMesa is damaged."""
    folder = tmp_path / "site-packages" / "sheetsplat"
    shutil.copytree(Path(ss.__file__).parent, folder, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    shutil.copy(_sheetsplat.__file__, folder)
    hiding = tmp_path / "hiding"
    hiding.mkdir()
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        (hiding / name).write_bytes(b"")
    return folder.parent


def osmesa_of(packages: Path) -> tuple[bool, str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SHEETSPLAT_")}
    environment["LD_LIBRARY_PATH"] = str(packages.parent / "hiding")
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(packages)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
        check=True,
    )
    [[_, available, description]] = json.loads(done.stdout)
    return available, description


def test_a_hidden_library_is_missing(packages):
    available, description = osmesa_of(packages)
    assert not available
    assert "sheetsplat[osmesa]" in description


def test_the_library_of_the_wheel_is_found(packages):
    """With the libraries of the wheel where it is installed, else with those of the system under the wheel's names."""
    wheel = next(
        (Path(one) / "lavavu_osmesa.libs" for one in sys.path if (Path(one) / "lavavu_osmesa.libs").is_dir()), None
    )
    if wheel is not None:
        (packages / "lavavu_osmesa.libs").symlink_to(wheel)
    else:
        found = [one for one in Path("/usr/lib").glob("*/libOSMesa.so.*") if one.is_file()]
        if not found:
            pytest.skip("needs libOSMesa, of the wheel lavavu-osmesa or of the system")
        (packages / "lavavu_osmesa.libs").mkdir()
        (packages / "lavavu_osmesa.libs" / "libOSMesa-0123abcd.so.8.0.0").symlink_to(found[0].resolve())
    available, description = osmesa_of(packages)
    assert available, description


def test_a_damaged_library_of_the_wheel_is_told(packages):
    (packages / "lavavu_osmesa.libs").mkdir()
    (packages / "lavavu_osmesa.libs" / "libOSMesa-0123abcd.so.8.0.0").write_bytes(b"no library")
    available, description = osmesa_of(packages)
    assert not available
    assert "libOSMesa-0123abcd" in description
