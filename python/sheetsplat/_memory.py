"""Available memory, by which sizes from files are checked before anything is allocated."""

from __future__ import annotations

from pathlib import Path

from sheetsplat.errors import OutOfMemory, Words, complain

_GROUPS = Path("/sys/fs/cgroup")


def _proc_available() -> int | None:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return None


def _reclaimable(stat: Path, key: str) -> int:
    """Return the bytes of files that a control group keeps and gives back where it needs them."""
    try:
        return next(int(line.split()[1]) for line in stat.read_text().splitlines() if line.split()[:1] == [key])
    except (OSError, ValueError, IndexError, StopIteration):
        return 0


def _group_available() -> int | None:
    # Version 2 of control groups, then version 1; a group without a limit says "max" or a number near 2**63.
    for folder, limit, used, kept in (
        ("", "memory.max", "memory.current", "inactive_file"),
        ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    ):
        try:
            group = _GROUPS / folder
            taken = int((group / used).read_text()) - _reclaimable(group / "memory.stat", kept)
            return max(0, int((group / limit).read_text()) - max(0, taken))
        except (OSError, ValueError):
            continue
    return None


def _process_available() -> int | None:
    try:
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft == resource.RLIM_INFINITY:
            return None
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        return max(0, soft - pages * resource.getpagesize())
    except (ImportError, OSError, ValueError):
        return None


def available() -> int:
    """Return the bytes that this process may still allocate, by the machine and the limits set on it."""
    known = [limit for limit in (_proc_available(), _group_available(), _process_available()) if limit is not None]
    return min(known, default=2**62)


def require(size: int, what: str, advice: str | Words = "use a smaller volume, or a narrower type of samples") -> None:
    """Raise OutOfMemory where `size` bytes for `what` are more than are available."""
    limit = available()
    if size > limit:
        raise complain(
            f"there is not enough memory for {what}",
            f"{limit / 1e6:,.0f} MB",
            f"{size / 1e6:,.0f} MB",
            advice,
            kind=OutOfMemory,
        )
