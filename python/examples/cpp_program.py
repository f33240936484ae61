"""C++: the sample program.

`sheetsplat_render` uses the public headers alone (`cpp/apps/sheetsplat_render.cpp`). `./run build` puts it into
`build/cpp/apps`. This script runs it, and reads the picture that it writes.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np
from PIL import Image

SIZE = (420, 380)

built = Path(__file__).resolve().parents[2] / "build" / "cpp" / "apps" / "sheetsplat_render"
program = str(built) if built.is_file() else shutil.which("sheetsplat_render")
if program is None:
    raise SystemExit("sheetsplat_render was not found: build it with ./run build")
command = [program, "--generate", "ellipsoids", "--kernels", "3000", "--elevation", "60"]
command += ["--size", f"{SIZE[0]}x{SIZE[1]}", "-o", "cpp_program.png"]
print(" ".join(["sheetsplat_render", *command[1:]]))
subprocess.run(command, check=True)
print(f"{np.asarray(Image.open('cpp_program.png'))[..., 3].mean() / 255:.2f} of the picture is covered")
