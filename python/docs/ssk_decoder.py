"""Read a .ssk file with NumPy and the range coder of the package constriction: ``python ssk_decoder.py FILE.ssk``.

Returns the centres, radii (in index coordinates) and coefficients of the kernels, and the base: the field is
base + sum of coefficient * g(distance / radius), g(r) = max(0, (exp(-k r^2) - exp(-k)) / (1 - exp(-k))), k the falloff.
"""

import itertools
import struct
import sys
import zlib

import constriction
import numpy as np

CONTEXTS, MAGNITUDES = 32, 16
CLASSES = np.array([0, 1, 2, 3, 3, 4, 4, 4, 4] + [5] * 8 + [6] * 64)


def chunks_of(data):
    """Return the kinds and contents of the chunks that are whole."""
    assert data[:4] == b"SSK\x01"
    at, found = 4, []
    while at + 7 <= len(data):
        kind, length, check = struct.unpack_from("<cIH", data, at)
        inside = data[at + 7 : at + 7 + length]
        if len(inside) < length:
            break  # The file ends early: what is whole is a coarser field.
        assert zlib.crc32(inside, zlib.crc32(kind)) & 0xFFFF == check
        found.append((kind, inside))
        at += 7 + length
    return found


def header_of(data):
    """Return the numbers of a chunk G by their names."""
    names = "version flags levels layers full nx ny nz finest falloff radius base step low high".split()
    head = dict(zip(names, struct.unpack_from("<BBBBH3I3f2d2f", data), strict=True))
    more = list(np.frombuffer(data, "<f8", offset=struct.calcsize("<BBBBH3I3f2d2f")))
    flags = head["flags"]
    head["origin"] = np.array([more.pop(0) for _ in range(3)]) if flags & 4 else np.zeros(3)
    head["steps"] = np.array([more.pop(0) for _ in range(9)]).reshape(3, 3) if flags & 8 else np.eye(3)
    x, y, z = (head[name] - 1.0 for name in ("nx", "ny", "nz"))
    half = 0.5 * (z >= 1.0)
    extent = (x + half, y + half, 0.5 * z) if flags & 1 else (x, y, z)
    head["extent"] = [more.pop(0) for _ in range(3)] if flags & 16 else extent
    return head


def nodes_of(head, level):
    """Return the first node and the numbers of nodes along x, y, z, and their distance."""
    spacing = head["finest"] * 2.0**level
    more = level > 0 or head["levels"] == 1
    first = np.array([-int(more and length > 0.0) for length in head["extent"]])
    counts = [int(np.ceil(length / spacing)) + 1 for length in head["extent"]] - 2 * first
    return first, counts, spacing


def starting_tables():
    """Return how often each context has met each magnitude before the first one."""
    above, beside = np.divmod(np.arange(CONTEXTS), 8)
    mean = 0.02 * 4.0**above * 2.0 ** np.where(beside == 7, 2, beside)
    ratio = (mean / (1.0 + mean))[:, None]
    return np.maximum(1, np.rint(128 * (1.0 - ratio) * ratio ** np.arange(MAGNITUDES))).astype(np.int64)


def contexts_of(own, where, phase, first, coarser, of_coarser):
    """Return the contexts of the nodes of a phase."""
    shape = own[where].shape
    above = np.full(shape, 2)
    if coarser is not None:
        magnitudes = np.pad(np.minimum(np.abs(coarser), 3), 3)
        odd = [phase >> axis & 1 for axis in (2, 1, 0)]
        begin = [(first[2 - axis] + where[axis].start - odd[axis]) // 2 - of_coarser[2 - axis] + 3 for axis in range(3)]

        def largest(steps):
            found = np.zeros(shape, int)
            for step in itertools.product(*steps):
                part = tuple(slice(a + by, a + by + n) for a, by, n in zip(begin, step, shape, strict=True))
                found = np.maximum(found, magnitudes[part])
            return found

        near, wide = largest([range(one + 1) for one in odd]), largest([(-1, 0, 1)] * 3)
        above = np.where(near > 0, np.where(near == 1, 2, 3), wide > 0)
    if phase == 0:
        return 8 * above + 7
    around, total, weights = np.pad(np.minimum(np.abs(own), 7), 1), np.zeros(shape, int), 0
    for dz, dy, dx in itertools.product((-1, 0, 1), repeat=3):
        if (phase ^ (abs(dx) | abs(dy) << 1 | abs(dz) << 2)) < phase:
            weight = 2 if abs(dx) + abs(dy) + abs(dz) == 1 else 1
            begin = [one.start + 1 + by for one, by in zip(where, (dz, dy, dx), strict=True)]
            part = tuple(slice(a, a + 2 * n - 1, 2) if n else slice(0) for a, n in zip(begin, shape, strict=True))
            total, weights = total + weight * around[part], weights + weight
    return 8 * above + np.where(total == 0, 0, CLASSES[np.minimum(8 * total // weights + 1, 80)])


def read_level(decoder, tables, own, first, coarser, of_coarser):
    """Read the numbers of a level into own."""
    model = constriction.stream.model
    for phase in range(8):
        starts = [((phase >> axis & 1) - first[axis]) & 1 for axis in (2, 1, 0)]
        where = tuple(slice(start, None, 2) for start in starts)
        contexts = contexts_of(own, where, phase, first, coarser, of_coarser).ravel()
        numbers = np.zeros(contexts.size, np.int64)
        for context in range(CONTEXTS):
            places, begin, run = np.flatnonzero(contexts == context), 0, 32
            while begin < len(places):
                some = places[begin : begin + run]
                counts = tables[context]
                table = model.Categorical(counts / counts.sum(), perfect=False)
                numbers[some] = decoder.decode(table, len(some))
                counts += 8 * np.bincount(numbers[some], minlength=MAGNITUDES)
                while counts.sum() > 1 << 14:
                    counts[:] = (counts + 1) // 2
                begin, run = begin + run, min(2 * run, 4096)
        for place in np.flatnonzero(numbers == MAGNITUDES - 1):
            length = int(decoder.decode(model.Uniform(24)))
            rest = int(decoder.decode(model.Uniform(1 << length))) if length else 0
            numbers[place] = (1 << length) + rest + MAGNITUDES - 2
        known = np.flatnonzero(numbers)
        if known.size:
            numbers[known[decoder.decode(model.Uniform(2), known.size) == 1]] *= -1
        own[where] = numbers.reshape(own[where].shape)


def kernels_of(data):
    """Return centres (N, 3), radii (N,), coefficients (N,), base and falloff of the bytes of a file."""
    chunks = chunks_of(data)
    head = header_of(next(inside for kind, inside in chunks if kind == b"G"))
    last, tables = head["levels"] - 1, starting_tables()
    geometry = [nodes_of(head, level) for level in range(last + 1)]
    levels = [np.zeros(tuple(int(n) for n in counts[::-1]), np.int64) for _, counts, _ in geometry]
    for layer in (inside for kind, inside in chunks if kind == b"L"):
        begin, end, _, _ = struct.unpack_from("<BB2f", layer)
        words = np.frombuffer(layer, "<u4", offset=struct.calcsize("<BB2f")).astype(np.uint32)
        decoder = constriction.stream.queue.RangeDecoder(words)
        for level in range(last - begin, last - end - 1, -1):
            if head["full"] >> level & 1:
                coarser = (levels[level + 1], geometry[level + 1][0]) if level < last else (None, None)
                read_level(decoder, tables, levels[level], geometry[level][0], *coarser)
    centers, radii, values = [], [], []
    for level in range(last, -1, -1):
        first, _, spacing = geometry[level]
        at = np.argwhere((levels[level] != 0) | (level == last))
        width = np.sqrt(np.pi / (2.0 * head["falloff"])) * head["radius"] * spacing
        centers.append((at[:, ::-1] + first) * spacing)
        radii.append(np.full(len(at), head["radius"] * spacing))
        values.append(levels[level][tuple(at.T)] * head["step"] / width**1.5)
    world = head["origin"] + np.concatenate(centers) @ head["steps"]
    return world, np.concatenate(radii), np.concatenate(values), head["base"], head["falloff"]


if __name__ == "__main__":
    with open(sys.argv[1], "rb") as file:
        places, sizes, heights, level_of_zero, _ = kernels_of(file.read())
    print(f"{len(places)} kernels, radii {sizes.min():g} to {sizes.max():g}, base {level_of_zero:g}")
