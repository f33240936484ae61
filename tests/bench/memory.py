"""Memory of a process that draws a 256^3 volume."""

from __future__ import annotations

from functools import partial

import sheetsplat as ss
from bench.measure import attempt, data_file, in_new_process, renderer_for, resident
from bench.report import Goal, Options, Report, Row, columns
from sheetsplat import datasets


def drawn_volume(volume: str, edge: int, backend: str, size: tuple[int, int]) -> Row:
    """Draw a file, or the noisy ball where there is none, and return memory in MB; for a new process."""
    field = ss.open(volume) if volume else datasets.noisy_ball(edge).field()
    low, high = field.value_range
    points = [(low + 0.12 * (high - low), 0.3, 0.6, 0.2, 0.0), (high, 0.7, 0.5, 0.3, 0.4)]
    scene = ss.Scene(field, points, lights=[ss.Light((0.3, 0.5, 1.0))])
    camera = ss.Camera.fit(field, direction=(-1.0, -0.7, -1.2))
    before = resident("VmHWM")
    stats = renderer_for(Options(backend=backend)).render(scene, camera, size=(size[0], size[1])).stats
    found = {"resident": resident("VmHWM"), "before": before, "field": field.memory}
    found |= {name: round(stats.get(f"bytes_{name}", 0.0)) for name in ("index", "view", "device")}
    row: Row = {name: 1e-6 * value for name, value in found.items()}
    row["kernels_drawn"] = round(stats["kernels_drawn"])
    row["per_kernel"] = 1e6 * (row["index"] + row["view"]) / max(row["kernels_drawn"], 1)
    return row


def run(options: Options) -> Report:
    """Measure the bonsai, where its file is present, and the noisy ball."""
    edge = options.edge(128)
    measure = partial(in_new_process, drawn_volume, edge=edge, backend=options.backend, size=options.size)
    options.say("bonsai")
    bonsai = "bonsai_256x256x256_uint8.nrrd"
    rows: list[Row] = [{"row": "bonsai, 256^3"} | attempt(lambda: measure(volume=str(data_file(options, bonsai))))]
    options.say("noisy ball")
    rows.append({"row": f"noisy ball, {edge}^3"} | measure(volume=""))
    goals: list[Goal] = []
    if "resident" in rows[0]:
        goals.append(Goal("resident memory for the bonsai", rows[0]["resident"], 700.0, "MB"))
    if options.scale == 1.0:
        goals += [
            Goal(f"kept for {row['row']}, a drawn kernel", row["per_kernel"], 16.0, "bytes")
            for row in rows
            if "per_kernel" in row
        ]
    return Report(
        name="memory",
        title=f"Memory at {options.size[0]}x{options.size[1]}",
        columns=columns(
            "row=volume, resident=peak resident MB, before=before drawing MB, field=field MB, kernels_drawn, "
            "index=index MB, view=view MB, device=device MB, per_kernel=bytes a drawn kernel, remark"
        ),
        rows=rows,
        notes=["Each in a new process. bytes a drawn kernel: index and view together, in addition to the volume."],
        goals=goals,
    )
