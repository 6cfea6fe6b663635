# SPDX-License-Identifier: Apache-2.0
"""Brings a file to the disk from time to time, in a thread of its own: it may take a second, and nobody waits for it.

What was written is safe from the death of the process at once; what was synced is safe from a loss of power.
"""

from __future__ import annotations

import os
import threading


class Syncer:
    """Syncs one file.

    Args:
        descriptor: of the file, which must stay open until `close`.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._failure: OSError | None = None
        self._asked, self._closing = threading.Event(), False
        self._thread = threading.Thread(target=self._run, name="syncer", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Have what was written so far brought to the disk soon.

        Raises:
            OSError: if that failed the last time.
        """
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
        self._asked.set()

    def close(self) -> OSError | None:
        """Wait until nothing is under way any more; gives a failure that was not told yet, which the system forgets."""
        self._closing = True
        self._asked.set()
        self._thread.join()
        failure, self._failure = self._failure, None
        return failure

    def _run(self) -> None:
        while True:
            self._asked.wait()
            self._asked.clear()
            if self._closing:
                return
            try:
                os.fdatasync(self._descriptor)
            except OSError as failure:
                self._failure = failure
