# SPDX-License-Identifier: MIT
"""Stand-in for Swabian's Python library with the functions that the bridge calls. It sends a known stream of tags.

The stream repeats a pattern of 1000 laser pulses with 1503 tags. Each pulse has a start tag. Every second pulse has a
click 20000 + 100 * (k % 200) ps later, where k is the pulse number. An overflow with 7 missed clicks precedes pulse
500.

Names and arguments are those in the vendor's documentation of version 2.22 ("TimeTagger classes", "Time-tag streaming",
"Helper classes", "Raw Time-Tag-Stream access"; CustomMeasurement.process(incoming_tags, begin_time, end_time) is "called
whenever a new chunk of time tags is available"). Its headers TimeTagger.h and Iterators.h declare the classes that the Python
module wraps (IteratorBase: isRunning, stop; CustomMeasurementBase: register_channel, finalize_init). The network and virtual
taggers are those of TimeTagger.h 2.16.2; run() exists in later versions only, and with STAND_IN_OLD_FILE=1, the virtual tagger
has setReplaySpeed() and replay() instead. A recording has three patterns. The count rate of the channels is 1e5/s at trigger
levels from 0.3 to 1.2 V, or 0 with STAND_IN_PLATEAU=none. With STAND_IN_CPU=file, the processor time of generating tags, s,
is written to the file."""
import os
import threading
import time

import numpy as np
import recorder
from recorder import called, complete, constant

PUBLISHED = """
module: createTimeTagger(serial resolution) createTimeTaggerNetwork(address)
    createTimeTaggerVirtual(filename begin duration) getVersion() scanTimeTagger() freeTimeTagger(tagger)
TimeTagger: getTriggerLevel(channel) getDACRange() getModel() getSerial() getFirmwareVersion()
    setTestSignal(channel enabled) setTriggerLevel(channel voltage) setInputDelay(channel delay)
    setDelayHardware(channel delay) setDelaySoftware(channel delay) setDeadtime(channel deadtime)
    setConditionalFilter(trigger filtered hardwareDelayCompensation) setEventDivider(channel divider) sync(timeout)
TimeTaggerNetwork: isConnected() setDelayClient(channel time)
TimeTaggerVirtual: run(speed) setReplaySpeed(speed) replay(file begin duration queue) waitForCompletion(ID timeout)
    setInputDelay(channel delay)
Countrate: __init__(tagger channels) startFor(capture_duration clear) waitUntilFinished(timeout) getData()
TimeTagStream: __init__(tagger n_max_events channels) isRunning() getData() stop()
TimeTagStreamBuffer: getEventTypes() getMissedEvents() getChannels() getTimestamps()
CustomMeasurement: __init__(tagger) register_channel(channel) finalize_init()
    process(incoming_tags begin_time end_time) isRunning() stop()"""
PULSES, CLICKS, MISSED = 1000, 500, 7
PATTERN_TAGS = PULSES + CLICKS + 3
RATE = float(os.environ.get("STAND_IN_PULSES_PER_S", "50000"))  # with inf, the buffer is always full
DEAD_TIME_STEP_PS = 2000
BLOCK_S, BLOCK_TAGS = 0.02, 131072  # default values of setStreamBlockSize()
TAG = np.dtype([("type", "u1"), ("missed_events", "u2"), ("channel", "i4"), ("time", "i8")], align=True)
# Tags end with this batch of 20 ms, if it is not 0, while isRunning() remains true. sync() times out if the device is unplugged,
# but not if the laser is off.
unplugged = dark = 0


class Resolution:
    Standard, HighResA, HighResB, HighResC = range(4)


def getVersion():
    return "2.22.0"


def scanTimeTagger():
    return ["STAND-IN-1"]


def createTimeTagger(serial="", resolution=0):
    called("createTimeTagger", serial, *[resolution] * bool(resolution))
    return TimeTagger()


def createTimeTaggerNetwork(address="localhost:41101"):
    called("createTimeTaggerNetwork", address)
    return TimeTaggerNetwork()


def createTimeTaggerVirtual(filename="", begin=0, duration=-1):
    called("createTimeTaggerVirtual", filename)
    return TimeTaggerVirtual()


def freeTimeTagger(tagger):
    called("freeTimeTagger")


class TimeTagger:
    getModel, getSerial, getFirmwareVersion = map(constant, ("Time Tagger Ultra", "STAND-IN-1", "Version: 2\nFPGA: 10"))
    getDACRange = constant([-2.5, 2.5])

    def __init__(self):
        self.batches, self.levels = 0, {}
        self.most = float("inf")  # number of patterns still to be sent

    @property
    def silent(self):
        """Returns True if a fault has stopped the stream of tags."""
        return any(n and self.batches >= n for n in (unplugged, dark))

    def setTriggerLevel(self, channel, voltage):
        called("setTriggerLevel", channel, voltage)
        self.levels[channel] = voltage

    def getTriggerLevel(self, channel):
        return self.levels.get(channel, 0.5)

    def setDeadtime(self, channel, deadtime):
        called("setDeadtime", channel, deadtime)
        return -(-deadtime // DEAD_TIME_STEP_PS) * DEAD_TIME_STEP_PS

    def sync(self, timeout=-1):
        called("sync")
        if not (self.silent and unplugged):
            return True
        assert timeout >= 0, "this would wait for ever"
        time.sleep(1e-3 * timeout)
        return False


class TimeTaggerNetwork(TimeTagger):
    isConnected = constant(True)


class TimeTaggerVirtual:
    """Virtual tagger without a model, a serial number or hardware settings, like the vendor's class."""

    def __init__(self):
        self.batches, self.silent, self.most = 0, False, 0

    def waitForCompletion(self, ID=0, timeout=-1):
        return self.most == 0

    def run(self, speed=-1.0):
        called("run", speed)
        self.most = 3

    def replay(self, file, begin=0, duration=-1, queue=True):
        called("replay", file)
        self.most = 3


class Countrate:
    def __init__(self, tagger, channels):
        called("Countrate", channels)
        self._tagger, self._channel = tagger, channels[0]

    def getData(self):
        level = self._tagger.levels[self._channel]
        rate = 1e5 if 0.3 <= level <= 1.2 else 3e7 * (abs(level) < 0.05)  # amplifier noise near 0 V
        return np.array([rate if os.environ.get("STAND_IN_PLATEAU") != "none" else 0.0])


class TimeTagStreamBuffer:
    def __init__(self, types, missed, channels, times):
        self.size = len(times)
        self.getEventTypes, self.getMissedEvents, self.getChannels, self.getTimestamps = (
            lambda column=column: column for column in (types, missed, channels, times))


def pattern(start_channel, click_channel, period_ps):
    pulse = np.arange(PULSES, dtype="i8")
    clicks = pulse[::2]
    overflow = np.full(3, 500 * period_ps - 1)
    times = np.concatenate([pulse * period_ps, clicks * period_ps + 20000 + 100 * (clicks % 200), overflow])
    types = np.concatenate([np.zeros(PULSES + CLICKS), [2, 4, 3]]).astype("u1")
    missed = np.concatenate([np.zeros(PULSES + CLICKS + 1), [MISSED, 0]]).astype("u2")
    channels = np.concatenate([np.full(PULSES, start_channel), np.full(CLICKS, click_channel),
                               [0, click_channel, 0]]).astype("i4")
    order = np.argsort(times, kind="stable")
    return types[order], missed[order], channels[order], times[order]


class Source:
    """Generates the tags that are due, as whole patterns."""

    def __init__(self, tagger, channels, most):
        self._tagger = tagger
        self._period_ps = 5_000_000 if RATE == float("inf") else round(1e12 / RATE)
        longest = -(-min(most, 1 << 20) // PATTERN_TAGS)
        self._records = np.zeros(longest * PATTERN_TAGS, TAG)  # the padding bytes are also zero
        for name, column in zip(TAG.names, pattern(*channels, self._period_ps)):
            self._records[name] = np.tile(column, longest)
        self._records["time"] += np.repeat(np.arange(longest), PATTERN_TAGS) * PULSES * self._period_ps
        self._most = min(most, len(self._records))
        self._began = time.monotonic()
        self._done = 0  # number of patterns sent

    def _next(self):
        """Returns the number of tags that are due, and the offset to add to the times in the pattern."""
        self._tagger.batches += 1
        if self._tagger.silent:
            return 0, 0
        if RATE == float("inf"):
            return self._most, 0
        due = min(self.patterns_due(), self._most // PATTERN_TAGS, self._tagger.most)
        self._done += due
        self._tagger.most -= due
        return due * PATTERN_TAGS, (self._done - due) * PULSES * self._period_ps

    def patterns_due(self):
        return int((time.monotonic() - self._began) * RATE / PULSES) - self._done

    def is_behind(self):
        return RATE == float("inf") or self.patterns_due() * PATTERN_TAGS > self._most

    def write(self, tags):
        """Writes the tags that are due to the front of the array and returns their number."""
        count, shift_ps = self._next()
        tags[:count].view("u1")[:] = self._records[:count].view("u1")
        tags[:count]["time"] += shift_ps
        return count


class TimeTagStream:
    def __init__(self, tagger, n_max_events, channels):
        called("TimeTagStream", n_max_events, channels)
        self._source, self._tags = Source(tagger, channels, n_max_events), np.empty(n_max_events, TAG)

    def isRunning(self):
        recorder.happen("isRunning")
        return True

    def getData(self):
        recorder.happen("getData")
        tags = self._tags[:self._source.write(self._tags)]
        return TimeTagStreamBuffer(*(tags[name].copy() for name in TAG.names))


class CustomMeasurement:
    """Calls process() on its own thread, like the vendor's class.

    The thread holds the mutex during the call, and overwrites the array after the call."""

    def __init__(self, tagger):
        called("CustomMeasurement")
        self.mutex = threading.Lock()
        self._standin_tagger, self._standin_channels = tagger, []
        self._standin_end = threading.Event()
        self._standin_thread = threading.Thread(target=self._standin_run, daemon=True)

    def register_channel(self, channel):
        called("register_channel", channel)
        self._standin_channels.append(channel)

    def finalize_init(self):
        called("finalize_init")
        self._standin_thread.start()

    def isRunning(self):
        recorder.happen("isRunning")
        return True

    def stop(self):
        called("stop")
        self._standin_end.set()
        self._standin_thread.join()

    def _standin_run(self):
        source = Source(self._standin_tagger, self._standin_channels, BLOCK_TAGS)
        buffer, in_process = np.empty(BLOCK_TAGS, TAG), 0.0
        while not self._standin_end.wait(0 if source.is_behind() else BLOCK_S):
            tags = buffer[:source.write(buffer)]
            if len(tags):
                began = time.thread_time()
                with self.mutex:
                    self.process(tags, tags["time"][0], tags["time"][-1])
                in_process += time.thread_time() - began
            tags.view("u1")[:] = 0xEE
        if path := os.environ.get("STAND_IN_CPU"):
            with open(path, "w", encoding="utf-8") as file:
                file.write(str(time.thread_time() - in_process))


complete(globals(), PUBLISHED)
for name in ["run"] if os.environ.get("STAND_IN_OLD_FILE") else ["setReplaySpeed", "replay"]:
    delattr(TimeTaggerVirtual, name)
