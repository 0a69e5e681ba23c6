"""Work in numbered shards: computed anywhere in any order, kept with checksums, joined to one result."""

from bumpstop.shards.result_folder import DamagedError, ResultFolder
from bumpstop.shards.run import JobResult, Progress, run
from bumpstop.shards.sharded_job import ShardedJob, code_digest, digest, to_jsonable, versions
from bumpstop.shards.workers import Workers

__all__ = [
    "DamagedError",
    "JobResult",
    "Progress",
    "ResultFolder",
    "ShardedJob",
    "Workers",
    "code_digest",
    "digest",
    "run",
    "to_jsonable",
    "versions",
]
