"""All workers of a distributed system in one process."""

from collections.abc import Sequence

from fecloth.distributed.partition import PartDescription
from fecloth.distributed.worker import Worker


class LocalLink:
    """A `Link` whose workers are all in this process."""

    def __init__(self, size: int):
        self.size = size
        self.workers: list[Worker] = []

    def begin(self, descriptions: Sequence[PartDescription]) -> Worker:
        self.workers = [Worker(description) for description in descriptions]
        return self.workers[0]

    def call_each(self, name: str, arguments: Sequence[tuple]) -> list:
        pairs = zip(self.workers, arguments, strict=True)
        return [getattr(worker, name)(*own) for worker, own in pairs]
