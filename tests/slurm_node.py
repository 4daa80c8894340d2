"""Slurm on this machine alone: its daemons with files of their own in a folder, started and ended again."""
import ctypes
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


PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>


def end_with_parent():
    """A daemon ends with the program that started it, whatever ends that."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


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
            self._start("munged", "--foreground", "--force", f"--key-file={key}", f"--socket={here}/munge.socket",
                        f"--pid-file={here}/munged.pid", f"--log-file={here}/munged.log", f"--seed-file={here}/munged.seed")
            self._wait_for(["munge", "--no-input", f"--socket={here}/munge.socket"], "munged")
            self._start("slurmctld", "-D")
            self._start("slurmd", "-D", "-N", "localhost")
            self._wait_for(["sinfo", "--noheader", "--states=idle", "--format=%t"], "slurmctld", "idle")
        except OSError:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for daemon in reversed(self._running):
            daemon.terminate()
            try:
                daemon.wait(5)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def _start(self, *command):
        with open(self.folder / f"{command[0]}.out", "wb") as said:
            self._running.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=self.environment,
                                                  preexec_fn=end_with_parent))

    def _wait_for(self, question, name, answer=""):
        """Until it is answered."""
        for _ in range(200):
            done = subprocess.run(question, capture_output=True, text=True, env=self.environment)
            if done.returncode == 0 and answer in done.stdout:
                return
            if ended := [daemon.args[0] for daemon in self._running if daemon.poll() is not None]:
                name = ended[0]
                break
            time.sleep(0.05)
        raise OSError(f"{name}: {(self.folder / f'{name}.out').read_text()}")
