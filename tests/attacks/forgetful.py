"""Settings of Dask with which its scheduler remembers little of tasks that are done: it would look like growth."""

from __future__ import annotations

FORGETFUL = {
    "distributed.admin.low-level-log-length": 10,
    "distributed.admin.log-length": 10,
    "distributed.diagnostics.computations.max-history": 1,
}
