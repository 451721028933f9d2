"""Work in a process of its own: what crashes, never returns or takes all memory there ends nothing here."""

import faulthandler
import importlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

PLATFORM = sys.platform
# s, to end by itself.
_LAST = 2.0


class WorkerError(Exception):
    """A worker gave no answer; afterwards it is of no more use.

    Attributes
    ----------
    ending : str
        How its process ended, such as "SIGSEGV" or "exit code 3"; "" where it did not answer in time and was ended.
    """

    def __init__(self, ending: str):
        super().__init__(ending or "no answer in time")
        self.ending = ending


class Worker:
    """A process that answers requests, one after the other; it starts with the first of them.

    Ctrl-C is not for it, and what it prints goes to the standard error.

    Parameters
    ----------
    maker : str
        "module:function", which makes in the process what answers: a function of a request. Both can be pickled.
    fork : bool
        Begin as a copy of this process, where that is safe (Linux): within some ms, with all that is imported here.
    memory : int
        Bytes that it may take beside what it begins with, where the system can hold it to that (Linux); 0: any.
    """

    def __init__(self, maker: str, fork: bool = False, memory: int = 0):
        self._maker, self._fork, self._memory = maker, fork and PLATFORM == "linux", memory
        self._process: _Spawned | _Forked | None = None
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def ask(self, request: Any, timeout: float) -> Any:
        """Have the process answer.

        Parameters
        ----------
        request : object
        timeout : float
            s.

        Returns
        -------
        object
            The answer.

        Raises
        ------
        WorkerError
            The process ended, or gave no answer in time and was ended.
        """
        process = self._process = self._process or self._started()
        # A process that died is found out when it does not answer.
        with suppress(OSError):
            process.stdin.write(pickle.dumps(request))
            process.stdin.flush()
        try:
            answer = self._answers.get(timeout=timeout)
        except queue.Empty:
            process.kill()
            raise WorkerError("") from None
        except BaseException:  # Ctrl-C does not wait for the answer either
            process.kill()
            raise
        if answer is None:
            raise WorkerError(_ending(process.wait()))
        return answer[0]

    def close(self) -> None:
        """End the process, by force where it does not end by itself within some s."""
        process = self._process
        if process is None:
            return
        with suppress(OSError):
            process.stdin.close()
        try:
            process.wait(_LAST)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _started(self) -> "_Spawned | _Forked":
        process = (_Forked if self._fork else _Spawned)(self._maker, self._memory)
        threading.Thread(target=self._listen, args=(process.stdout,), daemon=True).start()
        return process

    def _listen(self, stream: Any) -> None:
        with stream, suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                self._answers.put((pickle.load(stream),))
        self._answers.put(None)


class _Spawned:
    """A new Python that serves."""

    def __init__(self, maker: str, memory: int):
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, maker, str(memory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        self.stdin: Any = self._process.stdin
        self.stdout: Any = self._process.stdout
        self.kill, self.wait = self._process.kill, self._process.wait


class _Forked:
    """A copy of this process that serves."""

    def __init__(self, maker: str, memory: int):
        asked, answered = os.pipe(), os.pipe()
        # What waits to be printed is printed once.
        sys.stdout.flush()
        sys.stderr.flush()
        with warnings.catch_warnings():
            # Of threads that the copy lacks: it needs none of them.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._number = os.fork()
        if self._number == 0:
            try:
                os.close(asked[1])
                os.close(answered[0])
                _serve(maker, memory, os.fdopen(asked[0], "rb"), os.fdopen(answered[1], "wb"))
            finally:
                os._exit(1)
        os.close(asked[0])
        os.close(answered[1])
        self.stdin, self.stdout = os.fdopen(asked[1], "wb"), os.fdopen(answered[0], "rb")
        self._code: int | None = None

    def kill(self) -> None:
        if self._code is None:
            os.kill(self._number, signal.SIGKILL)

    def wait(self, _: float | None = None) -> int:
        if self._code is None:
            self._code = os.waitstatus_to_exitcode(os.waitpid(self._number, 0)[1])
        return self._code


def _serve(maker: str, memory: int, requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer until the requests end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    faulthandler.disable()
    # What libraries print is no answer.
    os.dup2(2, 1)
    if memory:
        _hold_to(memory)
    waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(requests, waiting), daemon=True).start()
    module, _, function = maker.partition(":")
    answer = getattr(importlib.import_module(module), function)()
    while True:
        pickle.dump(answer(waiting.get()), answers)
        answers.flush()


def _read(stream: BinaryIO, requests: "queue.SimpleQueue[Any]") -> None:
    """Hand requests on; without their sender this process ends, also amid a call that never returns."""
    while True:
        try:
            requests.put(pickle.load(stream))
        except (EOFError, OSError, pickle.UnpicklingError):
            os._exit(0)


def _hold_to(memory: int) -> None:
    """Let this process take so many bytes more than it has, where the system knows such limits."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + memory
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _ending(code: int) -> str:
    """How a process ended, in words."""
    if code >= 0:
        return f"exit code {code}"
    with suppress(ValueError):
        return signal.Signals(-code).name
    return f"signal {-code}"


if __name__ == "__main__":
    # The pipe of the answers goes on under another number.
    _serve(sys.argv[1], int(sys.argv[2]), sys.stdin.buffer, os.fdopen(os.dup(1), "wb"))
