# SPDX-License-Identifier: MIT
"""The calls of Swabian's Python library that the bridge makes, with a known stream of tags.

A pattern of 1000 laser pulses: each is a start; every second one a click 20000 + 100 * (k % 200) ps
later; in front of pulse 500 an overflow in which 7 clicks were missed. 1503 tags."""
import os
import time

import numpy as np
import recorder
from recorder import called

PULSES, CLICKS, MISSED = 1000, 500, 7
PATTERN_TAGS = PULSES + CLICKS + 3
RATE = float(os.environ.get("STAND_IN_PULSES_PER_S", "50000"))  # inf: always as many as fit
DEAD_TIME_STEP_PS = 2000


def createTimeTagger(serial=""):
    called("createTimeTagger", serial)
    return TimeTagger()


def freeTimeTagger(tagger):
    called("freeTimeTagger")


class TimeTagger:
    def getModel(self):
        return "Time Tagger Ultra"

    def getSerial(self):
        return "STAND-IN-1"

    def getFirmwareVersion(self):
        return "Version: 2\nFPGA: 10"

    def setTestSignal(self, channel, enabled):
        called("setTestSignal", channel, enabled)

    def setTriggerLevel(self, channel, voltage):
        called("setTriggerLevel", channel, voltage)

    def setInputDelay(self, channel, delay):
        called("setInputDelay", channel, delay)

    def setDelayHardware(self, channel, delay):
        called("setDelayHardware", channel, delay)

    def setDelaySoftware(self, channel, delay):
        called("setDelaySoftware", channel, delay)

    def setDeadtime(self, channel, deadtime):
        called("setDeadtime", channel, deadtime)
        return -(-deadtime // DEAD_TIME_STEP_PS) * DEAD_TIME_STEP_PS

    def setConditionalFilter(self, trigger, filtered, hardwareDelayCompensation=True):
        called("setConditionalFilter", trigger, filtered)

    def setEventDivider(self, channel, divider):
        called("setEventDivider", channel, divider)

    def sync(self, timeout=-1):
        called("sync")


class TimeTagStreamBuffer:
    def __init__(self, types, missed, channels, times):
        self._columns = types, missed, channels, times
        self.size = len(times)

    def getEventTypes(self):
        return self._columns[0]

    def getMissedEvents(self):
        return self._columns[1]

    def getChannels(self):
        return self._columns[2]

    def getTimestamps(self):
        return self._columns[3]


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


class TimeTagStream:
    def __init__(self, tagger, n_max_events, channels):
        called("TimeTagStream", n_max_events, channels)
        self._most = n_max_events
        self._period_ps = 5_000_000 if RATE == float("inf") else round(1e12 / RATE)
        columns = pattern(*channels, self._period_ps)
        longest = -(-min(n_max_events, 1 << 20) // PATTERN_TAGS)
        self._columns = [np.tile(column, longest) for column in columns]
        self._columns[3] += np.repeat(np.arange(longest), PATTERN_TAGS) * PULSES * self._period_ps
        self._began = time.monotonic()
        self._done = 0  # patterns

    def isRunning(self):
        recorder.happen("isRunning")
        return True

    def getData(self):
        recorder.happen("getData")
        if RATE == float("inf"):
            return TimeTagStreamBuffer(*self._columns)
        due = int((time.monotonic() - self._began) * RATE / PULSES)
        tags = min((due - self._done) * PATTERN_TAGS, self._most, len(self._columns[0]))
        part = [column[:tags] for column in self._columns]
        part[3] = part[3] + self._done * PULSES * self._period_ps
        self._done = due
        return TimeTagStreamBuffer(*part)

    def stop(self):
        called("stop")
