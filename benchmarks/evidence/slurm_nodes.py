"""A SLURM of three nodes on this host, in a folder of its own, for ``slurm.py``: all on loopback, and ended with its context.

It needs root, and Debian's packages slurm-wlm and munge. Jobs, and whoever submits them, are of a user that is not root. Where
that user cannot reach the interpreter that runs this, a copy of it is put where it can.
"""

import importlib.util
import os
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from dimersweep.kernel.compiler.cache import files
from dimersweep.kernel.compiler.pipelines import pipeline
from dimersweep.kernel.compiler.versions import code_version

ROOT = Path(__file__).resolve().parents[2]
NODES, CPUS, USER = 3, 2, "nobody"
PROGRAMS = ("slurmctld", "slurmd", "munged", "sbatch", "squeue")

CONF = """
ClusterName=trial
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
SlurmUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
ReturnToService=2
KillWait=2
InactiveLimit=0
SchedulerParameters=sched_interval=2,batch_sched_delay=0,sched_min_interval=0
{nodes}
PartitionName=normal Nodes=n[1-{count}] Default=YES MaxTime=60 State=UP OverTimeLimit=0
PartitionName=closed Nodes=n1 MaxTime=60 State=DOWN
"""


class LeftOut(Exception):
    """What cannot be played here, with the reason."""


def why_not() -> str:
    """Why no SLURM can be set up here; "" if one can."""
    if os.geteuid() != 0:
        return "it takes root to set a SLURM up"
    if lacking := [name for name in PROGRAMS if shutil.which(name) is None]:
        return f"there is no {lacking[0]} (Debian: slurm-wlm, munge)"
    if importlib.util.find_spec("dask_jobqueue") is None:
        return "there is no dask_jobqueue (pip install '.[cluster]')"
    for place in (ROOT, *site_packages()):
        if subprocess.run(["test", "-x", place], check=False, **as_user()).returncode:
            return f"the user {USER}, of whom jobs are, cannot read {place}"
    return ""


def as_user() -> dict[str, Any]:
    """What starts a process as the user of jobs."""
    user = pwd.getpwnam(USER)
    return {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}


def site_packages() -> list[str]:
    """Where the packages of this process are."""
    return [path for path in sys.path if path.endswith("site-packages")]


def free_ports(count: int) -> list[int]:
    """Ports that nobody listens at."""
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


class Slurm:
    """A SLURM that runs; `environment` leads its commands and our own there."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.home = folder, folder / "home"
        self.daemons: list[subprocess.Popen[bytes]] = []
        self.user = pwd.getpwnam(USER)
        self.python = Path(sys.executable)
        self.environment: dict[str, str] = {}

    # --- what it is made of ---------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the daemons, and wait until all nodes are idle."""
        for name in ("state", "home", "home/bin", *(f"spool-n{k + 1}" for k in range(NODES))):
            (self.folder / name).mkdir(parents=True)
        self._reach_python()
        self._authenticate()
        host = socket.gethostname()
        first, *ports = free_ports(NODES + 1)
        nodes = "\n".join(
            f"NodeName=n{k + 1} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={CPUS} RealMemory=4000"
            for k, port in enumerate(ports)
        )
        conf = self.folder / "slurm.conf"
        conf.write_text(CONF.format(host=host, port=first, folder=self.folder, nodes=nodes, count=NODES))
        self._daemon("slurmctld", "-D", "-f", str(conf))
        for k in range(NODES):
            self._daemon("slurmd", "-D", "-f", str(conf), "-N", f"n{k + 1}")
        ends = time.monotonic() + 60
        while (told := self.said("sinfo", "-h", "-p", "normal", "-o", "%T %D")) != f"idle {NODES}":
            if time.monotonic() > ends:
                raise LeftOut(f"SLURM does not come up: {told}\n{self.log('slurmctld')}")
            time.sleep(0.2)

    def _daemon(self, *command: str) -> None:
        name = command[-1] if command[0] == "slurmd" else command[0]
        with (self.folder / f"{name}.out").open("wb") as out:
            self.daemons.append(subprocess.Popen(command, stdout=out, stderr=out, stdin=subprocess.DEVNULL))

    def _authenticate(self) -> None:
        key, place = self.folder / "munge.key", self.folder / "munge.socket"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        names = {each: self.folder / f"munge.{each}" for each in ("socket", "pid-file", "log-file", "seed-file")}
        files = [f"--{name}={path}" for name, path in names.items()]
        # --force: a folder below one that everybody may write to
        self._daemon("munged", "--foreground", "--force", f"--key-file={key}", *files)
        ends = time.monotonic() + 20
        while not place.exists():
            if time.monotonic() > ends:
                raise LeftOut("munged does not come up")
            time.sleep(0.1)

    def _reach_python(self) -> None:
        """Give the user of jobs an interpreter with this checkout, its packages, and the code that is compiled already."""
        self.python = Path(os.path.realpath(sys.executable))
        try:
            subprocess.run([self.python, "-c", ""], check=True, **as_user())
        except PermissionError:
            base, place = os.path.realpath(sys.base_prefix), self.folder / "python"
            left_out = shutil.ignore_patterns("site-packages", "test", "share")
            shutil.copytree(base, place, symlinks=True, ignore=left_out)
            self.python = place / self.python.relative_to(base)
        program = self.home / "bin" / "dimersweep"
        program.write_text(f'#!/bin/sh\nexec {self.python} -m dimersweep "$@"\n')
        program.chmod(0o755)
        self.environment = {
            "PATH": f"{self.home}/bin:{os.environ['PATH']}",
            "HOME": str(self.home),
            "LANG": "C.UTF-8",
            "SLURM_CONF": str(self.folder / "slurm.conf"),
            "PYTHONPATH": os.pathsep.join([str(ROOT), *site_packages()]),
            "PYTHONDONTWRITEBYTECODE": "1",
            "LD_LIBRARY_PATH": str(self.python.parents[1] / "lib"),  # else the system's libpython might be found first
        }
        place = self.home / ".cache" / "dimersweep"
        place.mkdir(parents=True)
        for file in files(code_version(pipeline())):
            shutil.copy2(file, place)
        self.own(self.home)

    def own(self, path: Path) -> None:
        """Make all below a path the user's."""
        subprocess.run(["chown", "-R", f"{self.user.pw_uid}:{self.user.pw_gid}", str(path)], check=True)

    def end(self) -> None:
        """End all that was started; no second signal comes between."""
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with suppress(OSError, subprocess.SubprocessError):
            self.said("scancel", "--full", "--signal=KILL", "--user", USER)
            self.said("scancel", "--user", USER)
            ends = time.monotonic() + 15  # else the steps of jobs outlive the daemons that they answer to
            while self.said("squeue", "-h", "-t", "R,CF,CG", "-o", "%i") and time.monotonic() < ends:
                time.sleep(0.5)
        for each in reversed(self.daemons):
            each.terminate()
        for each in reversed(self.daemons):
            try:
                each.wait(10)
            except subprocess.TimeoutExpired:
                each.kill()
                each.wait()

    # --- what is done with it -------------------------------------------------------------------------------------------

    def start_as_user(self, *command: str, folder: Path, out: Path, **more: str) -> subprocess.Popen[bytes]:
        """Start a command as the user of jobs; what it says goes to the file `out`."""
        with out.open("ab") as told:
            return subprocess.Popen(
                command,
                cwd=folder,
                env=self.environment | more,
                stdout=told,
                stderr=told,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                **as_user(),
            )

    def said(self, *command: str) -> str:
        """What a command of SLURM answers."""
        done = subprocess.run(
            command, env=os.environ | self.environment, capture_output=True, text=True, timeout=30, check=False
        )
        return (done.stdout + done.stderr).strip()

    def jobs(self, job: str) -> int:
        """How many of an array's jobs have not ended."""
        told = self.said("squeue", "-h", "-r", "-j", job, "-t", "PD,R,CF,CG", "-o", "%i").splitlines()
        return sum(line.startswith(job) for line in told)  # of one that is long gone it tells that it does not know it

    def log(self, name: str) -> str:
        """The end of a daemon's log."""
        path = self.folder / f"{name}.log"
        return path.read_text(errors="replace")[-2000:] if path.exists() else ""


@contextmanager
def slurm(folder: Path) -> Iterator[Slurm]:
    """A SLURM in a folder that does not exist yet."""
    folder.mkdir(parents=True)
    folder.chmod(0o755)
    made = Slurm(folder)
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        made.start()
        yield made
    finally:
        made.end()
        for number, handler in before.items():
            signal.signal(number, handler)
