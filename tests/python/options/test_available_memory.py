"""What memory a control group leaves: what files of it only cache is free."""

import pytest

from sheetsplat import _memory

MB = 10**6


@pytest.mark.parametrize(
    ("folder", "limit", "used", "kept"),
    [
        ("", "memory.max", "memory.current", "inactive_file"),
        ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    ],
)
def test_cached_files_are_free(tmp_path, monkeypatch, folder, limit, used, kept):
    group = tmp_path / folder
    group.mkdir(exist_ok=True)
    (group / limit).write_text(f"{200 * MB}\n")
    (group / used).write_text(f"{192 * MB}\n")
    monkeypatch.setattr(_memory, "_GROUPS", tmp_path)
    assert _memory._group_available() == 8 * MB
    (group / "memory.stat").write_text(f"anon 1\nactive_file {50 * MB}\n{kept} {100 * MB}\nslab 7\n")
    assert _memory._group_available() == 108 * MB
    # A file that lies, or is damaged, gives no more than the limit, and nothing.
    (group / "memory.stat").write_text(f"{kept} {900 * MB}\n")
    assert _memory._group_available() == 200 * MB
    (group / "memory.stat").write_text(f"{kept}\nnonsense\n\n")
    assert _memory._group_available() == 8 * MB
    (group / limit).write_text("max\n")
    assert _memory._group_available() is None
