// SPDX-License-Identifier: MIT
#include "acquire/devices/attached.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

std::string ids(const inventory::Attached& device) {
  char text[16];
  std::snprintf(text, sizeof text, "%04x:%04x", unsigned{device.vendor}, unsigned{device.product});
  return text;
}

std::string setting(const std::string& key, const std::string& address) {
  return "  " + key + " = \"" + printable(address) + "\"\n";
}

std::string node_text(const inventory::Node& node) {
  std::string text;
  if (!node.address.empty()) text += setting(node.key, node.address);
  if (!node.missing.empty())
    text += "  " + (node.key.empty() ? "" : node.key + ": ") + printable(node.missing) + '\n';
  return text;
}

Json json_of(const inventory::Node& node) {
  return {
      {"node", node.path}, {"key", node.key}, {"address", node.address}, {"missing", node.missing}};
}

Json json_of(const inventory::Attached& device) {
  Json nodes = Json::array();
  for (const auto& node : device.nodes) nodes.push_back(json_of(node));
  return {{"kind", device.kind},     {"id", ids(device)},           {"model", device.model},
          {"serial", device.serial}, {"firmware", device.firmware}, {"advice", device.advice},
          {"nodes", nodes}};
}

}  // namespace

AttachedList find_attached() {
  AttachedList list{inventory::list_attached(), {}, ""};
  try {
    list.cameras = depth::list_openni_devices();
  } catch (const Error& e) {
    list.camera_fault = e.what();
  }
  return list;
}

std::string names_of(const std::string& model, const std::string& serial,
                     const std::string& firmware) {
  std::string text;
  for (const auto& [what, name] :
       {std::pair{"model ", model}, {"serial ", serial}, {"firmware ", firmware}})
    if (!name.empty()) text += (text.empty() ? "" : ", ") + std::string(what) + printable(name);
  return text;
}

std::string to_text(const AttachedList& list) {
  std::string text;
  for (const auto& device : list.usb) {
    text += device.kind + ' ' + ids(device) + ": " +
            names_of(device.model, device.serial, device.firmware) + '\n';
    if (!device.advice.empty()) text += "  " + printable(device.advice) + '\n';
    for (const auto& node : device.nodes) text += node_text(node);
  }
  for (const auto& camera : list.cameras)
    text += "OpenNI2 camera: model " + printable(camera.model) + '\n' +
            setting("depth.address", "openni:" + camera.uri);
  if (!list.camera_fault.empty()) text += printable(list.camera_fault) + '\n';
  return text.empty() ? "nothing that could be one of our devices is attached\n" : text;
}

std::string to_json(const AttachedList& list) {
  Json usb = Json::array(), cameras = Json::array();
  for (const auto& device : list.usb) usb.push_back(json_of(device));
  for (const auto& camera : list.cameras)
    cameras.push_back({{"model", camera.model}, {"address", "openni:" + camera.uri}});
  // A device's strings are its own business: what is not UTF-8 is replaced.
  return Json{{"usb", usb}, {"openni", cameras}}.dump(-1, ' ', true,
                                                      Json::error_handler_t::replace);
}

}  // namespace echofuse::acquire
