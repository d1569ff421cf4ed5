"""Jobs on a small chain, and the files that each of its stages makes if nothing disturbs it.

A fault tells nothing new about the seconds in which an interpreter loads numba and VTK. Jobs are therefore forks of a
process that has loaded them, unless what is tried is the start of a process itself.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

# Of numba's layers only this one may be forked after its use; the results are the same.
os.environ["NUMBA_THREADING_LAYER"] = "workqueue"
for variable in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

SCENE = Path(__file__).with_name("chain.yaml")
PRODUCTS = {
    "phantom": "volume",
    "ct": "orientations",
    "charge": "charge",
    "solve": "flow",
    "analyze": "analysis",
}
WHOLE_CHAIN = "run"
STAGES = (*PRODUCTS, WHOLE_CHAIN)
PPMC = (sys.executable, "-m", "ppmc")
TIMEOUT = 300.0
FAILED, STORAGE, STOPPED, INTERRUPTED = 1, 5, 75, 130


class Job:
    """A command of ppmc in a process forked from this one.

    Parameters
    ----------
    arguments : sequence of str
        What stands behind ``ppmc`` on the command line.
    cwd : Path
        Where it runs.
    prepare : callable, optional
        Called in the new process before the command.
    held : bool
        Whether it waits for SIGCONT before it begins.
    """

    def __init__(
        self, arguments: Sequence[str], cwd: Path, prepare: Callable[[], None] | None = None, held: bool = False
    ) -> None:
        self.told_in = cwd / "told"
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            code = 99
            try:
                code = self._begin(arguments, cwd, prepare, held)
            finally:
                os._exit(code)
        self.code: int | None = None
        if held:
            os.waitpid(self.pid, os.WUNTRACED)

    def _begin(self, arguments: Sequence[str], cwd: Path, prepare: Callable[[], None] | None, held: bool) -> int:
        os.chdir(cwd)
        told = os.open(self.told_in, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        nowhere = os.open(os.devnull, os.O_RDWR)
        for number, target in ((0, nowhere), (1, nowhere), (2, told)):
            os.dup2(target, number)
        sys.argv = ["ppmc", *arguments]
        if held:
            os.kill(os.getpid(), signal.SIGSTOP)
        if prepare is not None:
            prepare()
        from ppmc.cli import run_command
        from ppmc.command_end import left_with
        from ppmc.interrupts import hold_streams, install

        hold_streams()
        install()
        try:
            left_with(lambda: run_command(list(arguments)))
        except SystemExit as end:
            return int(end.code or 0)
        return FAILED

    def wait(self, timeout: float = TIMEOUT) -> int:
        """Return the exit code, or minus the number of the signal that ended it; kill it when time is up."""
        end = time.monotonic() + timeout
        while self.code is None:
            done, status = os.waitpid(self.pid, os.WNOHANG)
            if done:
                self.code = os.waitstatus_to_exitcode(status)
            elif time.monotonic() > end:
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
                raise TimeoutError(f"not done after {timeout:.0f} s")
            else:
                time.sleep(0.005)
        return self.code

    @property
    def told(self) -> str:
        """What it said on standard error."""
        return self.told_in.read_text(errors="replace")


class Bench:
    """A folder with the inputs of every stage, and the files that each makes if nothing disturbs it.

    Attributes
    ----------
    folder : Path
    whole : dict of str to bytes
        The unbroken files of the whole chain by name.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copy(SCENE, folder / "scene.yaml")
        _run_here(folder)
        self.whole = files_of(folder / "whole")

    def clear(self, stage: str) -> Path:
        """Return an empty run folder with what the stage reads."""
        run = self.folder / "run"
        shutil.rmtree(run, ignore_errors=True)
        run.mkdir()
        for earlier, product in PRODUCTS.items():
            if stage in (earlier, WHOLE_CHAIN):
                break
            shutil.copy2(self.folder / "whole" / f"{product}.vtkhdf", run)
        return run

    def arguments(self, stage: str) -> list[str]:
        """Return what stands behind ``ppmc`` on the command line of a stage."""
        only = [] if stage == WHOLE_CHAIN else ["--only", stage]
        return ["run", "scene.yaml", "--workdir", "run", *only]

    def command(self, stage: str) -> list[str]:
        """Return the command line of a stage in an interpreter of its own."""
        return [*PPMC, *self.arguments(stage)]

    def product(self, stage: str) -> str:
        """Return the name of the file that a stage makes last."""
        return f"{PRODUCTS.get(stage, 'analysis')}.vtkhdf"

    def start(self, stage: str, prepare: Callable[[], None] | None = None, held: bool = False) -> Job:
        """Start a stage in a fork."""
        return Job(self.arguments(stage), self.folder, prepare, held)

    def process(self, stage: str) -> subprocess.Popen[str]:
        """Start a stage in an interpreter of its own."""
        return subprocess.Popen(
            self.command(stage), cwd=self.folder, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )

    def finish(self, stage: str) -> str:
        """Run a stage to its end and return what is wrong with the result, empty if nothing is."""
        try:
            job = self.start(stage)
            if job.wait() != 0:
                return f"the same command again: {job.code}, {last_line(job.told)}"
        except TimeoutError as error:
            return f"the same command again: {error}"
        found = files_of(self.folder / "run")
        if left := [name for name in found if re.search(r"partial|checkpoint|crash|\.tmp$|lock$|\.probe$", name)]:
            return f"left behind: {left[:3]}"
        if other := [name for name in found if self.whole.get(name) != found[name]]:
            return f"other bytes than an unbroken run: {sorted(other)[:3]}"
        return "" if self.product(stage) in found else f"no {self.product(stage)}"


def _run_here(folder: Path) -> None:
    """Run the chain in this very process, so that forks have modules and kernels at hand."""
    import ppmc.cli  # noqa: F401
    from ppmc.chain import run_chain
    from ppmc.scene import load_scene

    run_chain(load_scene(folder / "scene.yaml"), workdir=folder / "whole")


def files_of(folder: Path) -> dict[str, bytes]:
    """Return all files under a folder by their names."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def last_line(text: str) -> str:
    """Return the last line of a message."""
    return (text.strip().splitlines() or [""])[-1][:160]


def wrong_end(code: int, told: str, allowed: Sequence[int]) -> str:
    """Return what is wrong with how a command ended, empty if nothing is."""
    fine = code in allowed and "Traceback" not in told
    return "" if fine else f"exit code {code}, {last_line(told)}"
