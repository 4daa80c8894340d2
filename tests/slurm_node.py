"""Slurm on this machine alone: its daemons with files of their own in a folder, started and ended again."""
import os
import shutil
import signal
import socket
import subprocess
import time

CONFIGURATION = """ClusterName=test
SlurmctldHost=localhost
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthInfo=socket={folder}/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
MpiDefault=none
NodeName=localhost CPUs={processors} State=UNKNOWN
PartitionName=all Nodes=localhost Default=YES MaxTime=INFINITE State=UP
"""


def missing():
    """What this machine lacks for it, or None."""
    if not all(shutil.which(name) for name in ("munged", "slurmctld", "slurmd", "sbatch")):
        return "no slurm-wlm"
    return None if os.geteuid() == 0 else "Slurm's daemons need root here"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class SlurmNode:
    """Runs while a `with` lasts; `environment` is that of programs that submit to it. OSError where a daemon does not start."""

    def __init__(self, folder):
        self.folder = folder
        self._running = []
        self.environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}

    def __enter__(self):
        here = self.folder
        here.chmod(0o755)
        for name in ("state", "spool"):
            (here / name).mkdir()
        key = here / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        (here / "slurm.conf").write_text(
            CONFIGURATION.format(folder=here, ports=(free_port(), free_port()), processors=os.cpu_count()))
        try:
            self._start("munged", "--force", f"--key-file={key}", f"--socket={here}/munge.socket", f"--pid-file={here}/munged.pid",
                        f"--log-file={here}/munged.log", f"--seed-file={here}/munged.seed")
            self._start("slurmctld")
            self._start("slurmd", "-N", "localhost")
        except OSError:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for process in reversed(self._running):
            try:
                os.kill(process, signal.SIGTERM)
                for _ in range(100):
                    os.kill(process, 0)
                    time.sleep(0.05)
            except OSError:
                pass

    def _start(self, *command):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=self.environment)
        if done.returncode != 0:
            raise OSError(f"{command[0]}: {done.stdout}")
        self._running.append(self._process_of(command[0]))

    def _process_of(self, name):
        """The daemon writes its number once it has left the process that was started."""
        for _ in range(200):
            try:
                return int((self.folder / f"{name}.pid").read_text())
            except (OSError, ValueError):
                time.sleep(0.05)
        raise OSError(f"{name}: no number of a process")
