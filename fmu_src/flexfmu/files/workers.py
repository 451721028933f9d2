"""Work in a process of its own: what crashes, never returns or takes all memory there ends nothing here."""

import faulthandler
import functools
import importlib
import os
import pickle
import queue
import signal
import socket
import struct
import subprocess
import sys
import threading
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

PLATFORM = sys.platform
# s, to end by itself.
_LAST = 2.0
# By which number another process knows the end of a pipe, and that process's end.
if sys.platform == "win32":
    from msvcrt import get_osfhandle as _number, open_osfhandle

    _end = functools.partial(open_osfhandle, flags=os.O_BINARY)
else:
    _number = _end = int


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

    Attributes
    ----------
    ends : tuple of int
        Once it has started, not forked: of two more pipes, to read and to write; the maker's arguments are the others.
    """

    def __init__(self, maker: str, fork: bool = False, memory: int = 0):
        self._maker, self._fork, self._memory = maker, fork and PLATFORM == "linux", memory
        self.ends: tuple[int, ...] = ()
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
        self.send(request)
        return self.answer(timeout)

    def send(self, request: Any) -> None:
        """Have the process begin with a request.

        Parameters
        ----------
        request : object
        """
        process = self._process = self._process or self._started()
        # A process that died is found out when it does not answer.
        with suppress(OSError):
            process.stdin.write(pickle.dumps(request))
            process.stdin.flush()

    def answer(self, timeout: float) -> Any:
        """Wait for the answer to what was sent; as of `ask`."""
        process = self._process
        assert process is not None
        try:
            answer = self._answers.get(timeout=timeout)
        except queue.Empty:
            process.kill()
            raise WorkerError("") from None
        except BaseException:  # Ctrl-C does not wait for the answer either
            process.kill()
            raise
        if answer is None:
            raise WorkerError(self.ending())
        return answer[0]

    def ending(self) -> str:
        """How the process ended; it is given some s to do so."""
        process = self._process
        if process is None:
            return ""
        try:
            return _ending(process.wait(_LAST))
        except subprocess.TimeoutExpired:
            process.kill()
            return _ending(process.wait())

    def kill(self) -> None:
        """End the process at once."""
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """End the process, by force where it does not end by itself within some s."""
        process = self._process
        if process is None:
            return
        with suppress(OSError):
            process.stdin.close()
        self.ending()
        for end in self.ends:
            os.close(end)
        self.ends = ()

    def _started(self) -> "_Spawned | _Forked":
        process = (_Forked if self._fork else _Spawned)(self._maker, self._memory)
        self.ends = process.ends
        threading.Thread(target=self._listen, args=(process.stdout,), daemon=True).start()
        return process

    def _listen(self, stream: Any) -> None:
        with stream, suppress(EOFError, OSError, pickle.UnpicklingError):
            while True:
                self._answers.put((pickle.load(stream),))
        self._answers.put(None)


def _answers() -> tuple[int, int]:
    """Ends of a pipe, to read and to write.

    On POSIX whoever reads looks up ten times a second: a signal may have come just before it waited.
    """
    if sys.platform == "win32":
        return os.pipe()
    ends = socket.socketpair()
    ends[0].setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, 100_000))
    return ends[0].detach(), ends[1].detach()


class _Spawned:
    """A new Python that serves."""

    def __init__(self, maker: str, memory: int):
        theirs, ours = zip(os.pipe(), reversed(_answers()), strict=True)
        self.ends: tuple[int, ...] = ours[::-1]
        for end in theirs:
            os.set_inheritable(end, True)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, maker, str(memory), *(str(_number(end)) for end in theirs)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            close_fds=False,
        )
        for end in theirs:
            os.close(end)
        self.stdin: Any = self._process.stdin
        self.stdout: Any = self._process.stdout
        self.kill, self.wait = self._process.kill, self._process.wait


class _Forked:
    """A copy of this process that serves."""

    ends = ()

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


def _serve(maker: str, memory: int, requests: BinaryIO, answers: BinaryIO, ends: Sequence[int] = ()) -> None:
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
    answer = getattr(importlib.import_module(module), function)(*ends)
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

        most = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize() + memory
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
    own = [_end(int(number)) for number in sys.argv[3:]]
    for end in own:
        # No process that begins here keeps them open.
        os.set_inheritable(end, False)
    _serve(sys.argv[1], int(sys.argv[2]), sys.stdin.buffer, os.fdopen(os.dup(1), "wb"), own)
