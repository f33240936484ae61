"""Memory of a process that draws a 256^3 volume."""

from __future__ import annotations

from sheetsplat.bench._measure import attempt, data_folder
from sheetsplat.bench._report import Goal, Options, Report, Row, environment
from sheetsplat.bench.startup import in_new_process

_COLUMNS = {
    "row": "volume",
    "resident": "largest resident MB",
    "before": "of it before drawing MB",
    "field": "field MB",
    "kernels_drawn": "drawn",
    "index": "index MB",
    "view": "view MB",
    "device": "device MB",
    "per_kernel": "bytes a drawn kernel",
    "remark": "remark",
}

_SCRIPT = """
import json, sys
import sheetsplat
def resident():
    # The kernel's own mark for this program; that of getrusage would begin with the size of the parent process.
    with open("/proc/self/status") as status:
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM:"))
if sys.argv[1] == "ball":
    from sheetsplat import datasets
    field = datasets.noisy_ball(int(sys.argv[2])).field()
else:
    field = sheetsplat.open(sys.argv[1])
low, high = field.value_range
lower = low + 0.12 * (high - low)
points = [(lower, 0.3, 0.6, 0.2, 0.0), (high, 0.7, 0.5, 0.3, 0.4)]
scene = sheetsplat.Scene(field, points, lights=[sheetsplat.Light((0.3, 0.5, 1.0))])
camera = sheetsplat.Camera.fit(field, direction=(-1.0, -0.7, -1.2))
before = resident()
picture = sheetsplat.Renderer(sys.argv[3]).render(scene, camera, size=(int(sys.argv[4]), int(sys.argv[5])))
stats = picture.stats
names = ("kernels_drawn", "bytes_index", "bytes_view", "bytes_device")
print(json.dumps([resident(), before, field.memory] + [stats.get(name, 0.0) for name in names]))
"""


def _row(name: str, volume: str, edge: int, options: Options) -> Row:
    arguments = (volume, str(edge), options.backend, str(options.size[0]), str(options.size[1]))
    resident, before, field, drawn, index, view, device = in_new_process(_SCRIPT, *arguments)
    mega = 1e-6
    return {
        "row": name,
        "resident": mega * resident,
        "before": mega * before,
        "field": mega * field,
        "kernels_drawn": round(drawn),
        "index": mega * index,
        "view": mega * view,
        "device": mega * device,
        "per_kernel": (index + view) / max(drawn, 1.0),
    }


def run(options: Options) -> Report:
    """Measure the bonsai where it is at hand, and the noisy ball."""
    rows: list[Row] = []
    goals: list[Goal] = []
    path = data_folder(options) / "bonsai_256x256x256_uint8.nrrd"

    def bonsai() -> Row:
        if not path.is_file():
            raise FileNotFoundError(f"{path.name} is not in the data folder; set SHEETSPLAT_DATA")
        return _row("bonsai, 256^3", str(path), 0, options)

    options.say("bonsai")
    rows.append({"row": "bonsai, 256^3"} | attempt(bonsai))
    edge = options.edge(128)
    options.say("noisy ball")
    rows.append(_row(f"noisy ball, {edge}^3", "ball", edge, options))
    if "resident" in rows[0]:
        goals.append(Goal("resident memory for the bonsai", rows[0]["resident"], 700.0, "MB"))
    for row in rows:
        if "per_kernel" in row and options.scale == 1.0:
            goals.append(Goal(f"kept for {row['row']}, a drawn kernel", row["per_kernel"], 16.0, "bytes"))
    return Report(
        name="memory",
        title=f"Memory at {options.size[0]}x{options.size[1]}",
        columns=_COLUMNS,
        rows=rows,
        notes=["Each in a new process. bytes a drawn kernel: index and view together, beside the volume itself."],
        goals=goals,
        environment=environment(),
    )
