// SPDX-License-Identifier: MIT
// What is attached to this machine, for the `devices` command.
#pragma once
#include <string>
#include <vector>

#include "drivers/depth/openni_list.hpp"
#include "drivers/inventory/inventory.hpp"

namespace echofuse::acquire {

struct AttachedList {
  std::vector<inventory::Attached> usb;
  std::vector<depth::OpenNiDevice> cameras;
  std::string camera_fault;  // why OpenNI2 cannot be asked, if so
};

AttachedList find_attached();

// "model A, serial B, firmware C", of those that are known.
std::string names_of(const std::string& model, const std::string& serial,
                     const std::string& firmware);
// For people, with the lines to write into lab.toml.
std::string to_text(const AttachedList& list);
// {"usb": [...], "openni": [...]}
std::string to_json(const AttachedList& list);

}  // namespace echofuse::acquire
