# SPDX-License-Identifier: MIT
"""Functions that wait for other processes and detect processes that did not get enough processor time."""
import contextlib
import os
import pathlib
import subprocess
import sys
import threading
import time


def wait_for(what, condition, timeout_s=20, pause_s=0.02):
    """Waits until condition() is true. `what` is the error message for a timeout, or a function that returns this
    message."""
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {timeout_s} s: {what() if callable(what) else what}")
        time.sleep(pause_s)


def starved(*pids):
    """Returns a text with the measured wait if one of the processes has waited for a processor for more than 1 s and for
    more than 10 % of its lifetime. Returns an empty text otherwise."""
    uptime_s = float(pathlib.Path("/proc/uptime").read_text().split()[0])
    for pid in pids:
        folder, waited_s = pathlib.Path(f"/proc/{pid}"), 0.0
        with contextlib.suppress(OSError):  # the process may have ended
            fields = (folder / "stat").read_text()
            name, started = fields[fields.index("(") + 1:fields.rindex(")")], int(fields.rpartition(")")[2].split()[19])
            for file in folder.glob("task/*/schedstat"):
                with contextlib.suppress(OSError):  # the thread may have ended
                    waited_s += int(file.read_text().split()[1]) * 1e-9
            lifetime_s = uptime_s - started / os.sysconf("SC_CLK_TCK")
            if waited_s > max(1, 0.1 * lifetime_s):
                return f"{name} waited {waited_s:.1f} s for a processor in {lifetime_s:.1f} s"
    return ""


def descendants(pid):
    with contextlib.suppress(OSError):
        for file in pathlib.Path(f"/proc/{pid}").glob("task/*/children"):
            for child in file.read_text().split():
                yield from (child, *descendants(child))


def run(command, timeout=None, **streams):
    """Calls subprocess.run(). The result has the attribute `starved`: the text of starved() if the command or a program
    that it started was starved."""
    with subprocess.Popen(list(map(str, command)), **streams) as process:
        late, ended = [], threading.Event()

        def watch():
            while not ended.wait(0.1):
                late.extend(filter(None, [starved(process.pid, *descendants(process.pid))]))
        watcher = threading.Thread(target=watch)
        watcher.start()
        try:
            out, err = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            raise
        finally:
            ended.set()
            watcher.join()
    done = subprocess.CompletedProcess(command, process.returncode, out, err)
    done.starved = late[-1] if late else ""
    return done


def not_checked(what, why):
    """Prints the check that a starved machine cannot make, and the measured wait of its process. scripts/test lists
    these lines."""
    print(f"not checked: {what}: {why}", flush=True)


if __name__ == "__main__":
    # Programs that were starved may have ended, so that only the load of the machine shows it.
    sys.exit(not (starved(*sys.argv[1:]) or os.getloadavg()[0] > 2 * (os.cpu_count() or 1)))
