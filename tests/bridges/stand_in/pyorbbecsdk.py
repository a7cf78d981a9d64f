# SPDX-License-Identifier: MIT
"""Stand-in for Orbbec's Python SDK (version 2) with the functions that the bridge calls.

Names and numbers of arguments are those in the vendor's stub (orbbec/pyorbbecsdk, stubs/pyorbbecsdk.pyi at 9fcf324).
Functions that were added in version 2 are those in the bindings of version 2 (src/pyorbbecsdk/stream_profile.cpp). As in
releases of version 2, get_camera_param() returns zeros while the colour stream is off (issues 56 and 103 of the SDK).
The depth unit STAND_IN_SCALE is in mm. STAND_IN_INTRINSICS=zero, nan or wide (another image size) sets the intrinsics of the
depth profile, fails makes the SDK refuse them, and none removes them, as in version 1. See recorder.py for other settings."""
import time
import types

from recorder import called, complete, constant, happen, lacks, setting, values

PUBLISHED = """
Context: query_devices(0)
DeviceList: get_count(0) get_device_serial_number_by_index(1) get_device_by_serial_number(1)
Device: get_device_info(0) is_property_supported(2) set_bool_property(2) set_int_property(2)
    get_available_preset_list(0) load_preset(1) get_depth_work_mode_list(0) set_depth_work_mode(1)
DevicePresetList: get_count(0) get_name_by_index(1)
OBDepthWorkModeList: get_count(0) get_depth_work_mode_by_index(1)
DeviceInfo: get_name(0) get_serial_number(0) get_firmware_version(0)
Config: enable_stream(1)
StreamProfileList: get_video_stream_profile(4)
VideoStreamProfile: get_intrinsic(0) get_distortion(0)
Pipeline: __init__(1) get_stream_profile_list(1) start(1) stop(0) get_camera_param(0) wait_for_frames(1)
FrameSet: get_depth_frame(0)
DepthFrame: get_index(0) get_width(0) get_height(0) get_depth_scale(0) get_timestamp_us(0) get_data(0)"""
OBSensorType = types.SimpleNamespace(DEPTH_SENSOR="depth")
OBFormat = types.SimpleNamespace(Y16="y16")
OBPropertyID = types.SimpleNamespace(OB_PROP_DEPTH_MIRROR_BOOL="mirror", OB_PROP_LASER_BOOL="laser",
                                     OB_PROP_LASER_CONTROL_INT="laser control")
OBPermissionType = types.SimpleNamespace(PERMISSION_WRITE="write")
PRESETS = ["Default", "High Accuracy"]
DEPTH_MODES = ["Unbinned Dense Default", "Binned Sparse Default"]
SERIALS = ["STAND-IN-2", "STAND-IN-4"]
camera = types.SimpleNamespace(fx=50.0, fy=50.0, cx=31.5, cy=31.5, width=64, height=64)
distortion = types.SimpleNamespace(k1=0.0, k2=0.0, k3=0.0, k4=0.0, k5=0.0, k6=0.0, p1=0.0, p2=0.0)


class DepthFrame:
    get_width, get_height = constant(camera.width), constant(camera.height)

    def __init__(self, index):
        self._index = index

    def get_index(self):
        return self._index

    def get_depth_scale(self):
        return float(setting("SCALE", 1))

    def get_timestamp_us(self):
        return 1_000_000 + 66_667 * self._index

    def get_data(self):
        return values(self._index, camera.width * camera.height).view("u1")


class VideoStreamProfile:
    get_distortion = constant(distortion)

    def __init__(self, mode):
        self.mode = mode

    def get_intrinsic(self):
        fault = setting("INTRINSICS")
        if fault == "fails":
            raise RuntimeError("Can not find matched camera param!")
        changes = {"zero": {"fx": 0.0, "fy": 0.0}, "nan": {"cx": float("nan")}, "wide": {"width": 128}}
        return types.SimpleNamespace(**vars(camera) | changes.get(fault, {}))


class StreamProfileList:
    def get_video_stream_profile(self, width, height, format, fps):
        if (width, height) != (camera.width, camera.height):
            raise RuntimeError("Invalid input, no matched video stream profile found!")
        mode = width, height, format, fps
        return types.SimpleNamespace(mode=mode) if setting("INTRINSICS") == "none" else VideoStreamProfile(mode)


class Config:
    def enable_stream(self, profile):
        called("enable_stream", *profile.mode)


class Pipeline:
    def __init__(self, device):
        self._index = 0

    def get_stream_profile_list(self, sensor_type):
        called("get_stream_profile_list", sensor_type)
        return StreamProfileList()

    def start(self, config):
        called("start")
        self._index = 0

    def get_camera_param(self):
        zero = types.SimpleNamespace(**dict.fromkeys(vars(camera), 0))
        return types.SimpleNamespace(depth_intrinsic=zero, depth_distortion=distortion)

    def wait_for_frames(self, timeout):
        happen("wait_for_frames")
        time.sleep(0.02)
        self._index += 1
        return FrameSet(DepthFrame(self._index))


class DevicePresetList:
    def get_count(self):
        return 0 if lacks("preset") else len(PRESETS)

    def get_name_by_index(self, index):
        return PRESETS[index]


class OBDepthWorkModeList:
    get_count = constant(len(DEPTH_MODES))

    def get_depth_work_mode_by_index(self, index):
        return types.SimpleNamespace(name=DEPTH_MODES[index])


class DeviceInfo:
    get_name, get_serial_number, get_firmware_version = map(constant, ("Orbbec Gemini 2", "STAND-IN-2", "1.4.98"))


class Device:
    get_device_info = constant(DeviceInfo())
    get_available_preset_list, get_depth_work_mode_list = constant(DevicePresetList()), constant(OBDepthWorkModeList())

    def is_property_supported(self, property_id, permission_type):
        return not lacks(property_id) and permission_type == "write"

    def set_depth_work_mode(self, mode):
        called("set_depth_work_mode", mode.name)


class DeviceList:
    def get_count(self):
        return int(setting("CAMERAS", 1))

    def get_device_serial_number_by_index(self, index):
        return SERIALS[index]

    def get_device_by_serial_number(self, serial_number):
        called("get_device_by_serial_number", serial_number)
        return Device()


class Context:
    def query_devices(self):
        called("query_devices")
        return DeviceList()


class FrameSet:
    def __init__(self, frame):
        self.frame = frame

    def get_depth_frame(self):
        return self.frame


complete(globals(), PUBLISHED)
