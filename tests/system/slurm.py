#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests scripts/slurm on an emulated Slurm cluster of two nodes on this machine. One node fails during an array job, and the
result must be bit-identical to the result of a single process. Requires root and Debian's Slurm packages."""
import contextlib
import functools
import hashlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import unittest

from case import Case, bin_dir, source
import fixtures
import waiting

# Each check starts a program, so the pause between two checks is longer than usual.
wait_for = functools.partial(waiting.wait_for, pause_s=0.1)

scripts = source / "scripts/slurm"
NEEDED = ("slurmctld", "slurmd", "munged", "sbatch", "squeue", "scontrol")

CONF = """ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={dir}/munge.sock,cred_expire=10
SlurmctldPort={ports[0]}
SlurmctldPidFile={dir}/ctld.pid
SlurmdPidFile={dir}/slurmd.%n.pid
SlurmdSpoolDir={dir}/spool.%n
StateSaveLocation={dir}/state
SlurmctldLogFile={dir}/ctld.log
SlurmdLogFile={dir}/slurmd.%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,batch_sched_delay=0
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
ReturnToService=2
MpiDefault=none
KillWait=2
MinJobAge=300
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1 RealMemory=1000 State=UNKNOWN
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1 RealMemory=1000 State=UNKNOWN
PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    with contextlib.ExitStack() as stack:
        return [stack.enter_context(socket.create_server(("127.0.0.1", 0))).getsockname()[1] for _ in range(count)]


class Slurm(Case):
    def setUp(self):
        super().setUp()
        self.host = socket.gethostname().split(".")[0]
        for name in ("state", "spool.n1", "spool.n2", "tmp", "work"):
            (self.dir / name).mkdir()
        (self.dir / "slurm.conf").write_text(CONF.format(dir=self.dir, host=self.host, ports=free_ports(3)))
        (self.dir / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
        key = self.dir / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        os.environ |= {"SLURM_CONF": str(self.dir / "slurm.conf"), "TMPDIR": str(self.dir / "tmp"),
                       "PATH": f"{bin_dir}:{os.environ['PATH']}"}
        self.addCleanup(self.stop)
        munge = ["munged", "--force", f"--key-file={key}", f"--socket={self.dir}/munge.sock",
                 f"--pid-file={self.dir}/munged.pid", f"--log-file={self.dir}/munged.log",
                 f"--seed-file={self.dir}/munge.seed"]
        for command in (munge, ["slurmctld"], ["slurmd", "-N", "n1"], ["slurmd", "-N", "n2"]):
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=self.dir)
        wait_for("two idle nodes", lambda: self.ask("sinfo", "-h", "-t", "idle", "-o", "%D") == "2", 60)

    def ask(self, *words):
        return subprocess.run(words, text=True, capture_output=True).stdout.strip()

    def processes_of(self, *names):
        """Yields the IDs of the processes that were started with the configuration of this cluster. `names` lists
        further variables that must be in their environment."""
        mark = f"SLURM_CONF={self.dir}/slurm.conf".encode()
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # the process may have ended
                variables = (process / "environ").read_bytes().split(b"\0")
                if mark in variables and int(process.name) != os.getpid() and all(n.encode() in variables for n in names):
                    yield int(process.name)

    def stop(self):
        for name in ("slurmd.n1", "slurmd.n2", "ctld", "munged"):
            with contextlib.suppress(OSError, ValueError):
                os.kill(int((self.dir / f"{name}.pid").read_text()), signal.SIGKILL)
        self.kill(self.processes_of())

    def kill(self, processes):
        for process in processes:
            with contextlib.suppress(ProcessLookupError):  # the process has already ended
                os.kill(process, signal.SIGKILL)

    def halted(self, node, program):
        """Stops the program run by a job on this node. Returns True if the program was running."""
        for process in self.processes_of(f"SLURMD_NODENAME={node}"):
            with contextlib.suppress(OSError):
                if pathlib.Path(f"/proc/{process}/comm").read_text().strip() == program:
                    os.kill(process, signal.SIGSTOP)
                    return pathlib.Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "T"
        return False

    def node_dies(self, node):
        """Kills the daemon and all jobs on the node without warning, as a power failure would."""
        os.kill(int((self.dir / f"slurmd.{node}.pid").read_text()), signal.SIGKILL)
        jobs = list(self.processes_of(f"SLURMD_NODENAME={node}"))
        parents = {int(pathlib.Path(f"/proc/{job}/stat").read_text().rpartition(")")[2].split()[1]) for job in jobs}
        keepers = [pid for pid in parents if pathlib.Path(f"/proc/{pid}/comm").read_text().startswith("slurmstepd")]
        # The parent processes are killed first, because they would otherwise report the end of the jobs.
        self.kill([*keepers, *jobs])
        subprocess.run(["scontrol", "update", f"nodename={node}", "state=down", "reason=test"], check=True)

    def submit(self, script, *words):
        done = subprocess.run([scripts / script, *map(str, words)], cwd=self.dir / "work", text=True,
                              capture_output=True)
        self.assertEqual(done.returncode, 0, done.stderr)

    def finish(self):
        said = lambda: "".join(path.read_text() for path in (self.dir / "work").glob("*.out"))
        wait_for(lambda: self.ask("squeue", "-l") + said(), lambda: not self.ask("squeue", "-h"), 200)
        said = said()
        self.assertNotIn("error", said.lower())
        return said

    def records(self, *paths):
        rows = [row for path in paths for row in fixtures.query(path, "SELECT * FROM record ORDER BY idx")]
        return len(rows), hashlib.sha256(repr(rows).encode()).hexdigest()

    def test_data_set_is_complete_after_a_node_failure(self):
        settings = ["--records", "2400", "--set", "spd_rays=512"]
        self.submit("dataset.sbatch", 6, "base", *settings)
        wait_for("a part being made on the node", lambda: self.halted("n2", "echofuse-sim"), 120)
        self.node_dies("n2")
        wait_for("the job in the queue again", lambda: self.ask("squeue", "-h", "-r", "-t", "pending", "-o", "%A"), 30)
        subprocess.run(["slurmd", "-N", "n2"], check=True, cwd=self.dir)
        self.finish()
        self.assertIn("Restarts=1", self.ask("scontrol", "show", "job"))
        subprocess.run([bin_dir / "echofuse-sim", "dataset", "-q", "--out", self.dir / "whole.sqlite", *settings],
                       check=True)
        self.assertEqual(self.records(*(self.dir / f"work/base/part-{k}.sqlite" for k in range(1, 7))),
                         self.records(self.dir / "whole.sqlite"))


IN_ARRAY = {"SLURM_JOB_ID": "9", "SLURM_ARRAY_TASK_ID": "3", "SLURM_ARRAY_TASK_COUNT": "2", "SLURM_ARRAY_TASK_MIN": "3"}


class Resubmitted(Case):
    """Runs the scripts without Slurm as if they were tasks of a partly resubmitted array."""

    def task(self, script, *words):
        copy = shutil.copy(scripts / script, f"{self.new_folder(self.enterContext)}/slurm_script")
        return subprocess.run([copy, *words], cwd=self.dir, text=True, capture_output=True,
                              env={**os.environ, "PATH": f"{bin_dir}:{os.environ['PATH']}", **IN_ARRAY})

    def test_slurm_scripts_submit_their_array_from_within_another_job(self):
        fixtures.executable(self.dir / "sbatch", '#!/bin/sh\necho "$@" >> submitted\necho 7\n')
        for environment in ({"SLURM_JOB_ID": "77"}, IN_ARRAY):
            for script in ("dataset.sbatch", "study.sbatch"):
                subprocess.run([scripts / script, "4", "base"], cwd=self.dir, check=True, stdout=subprocess.DEVNULL,
                               env={**os.environ, "PATH": f"{self.dir}:{os.environ['PATH']}", **environment})
        submitted = (self.dir / "submitted").read_text().splitlines()
        merge = f"--dependency=afterok:7 {scripts / 'study.sbatch'} merge base"
        self.assertEqual((sum("--array=1-4" in line for line in submitted), submitted.count(merge)), (4, 2), submitted)

    def test_slurm_task_writes_only_its_part_of_the_data_set(self):
        for words in (["2", "."], ["none", "."]):  # invalid numbers of parts
            done = self.task("dataset.sbatch", *words)
            self.assertEqual((done.returncode, os.listdir(self.dir)), (2, []), done.stderr)
        done = self.task("dataset.sbatch", "8", ".", "--records", "16")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(fixtures.query(self.dir / "part-3.sqlite", "SELECT idx FROM record ORDER BY idx"), [(4,), (5,)])
        for part, said in ("8", "a study --part 3/8\n"), ("merge", "a study\n"):
            self.assertEqual(self.task("study.sbatch", part, "echo", "a study").stdout, said)


if "Resubmitted" not in sys.argv and (os.geteuid() != 0 or not all(shutil.which(name) for name in NEEDED)):
    print("skipped: needs root and", ", ".join(NEEDED), "(./scripts/setup --all)")
    sys.exit(77)
unittest.main(argv=sys.argv[:1] + sys.argv[2:])
