// SPDX-License-Identifier: MIT
// The three sensors, arrays with one value per sensor, and sets of sensors.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>

namespace echofuse {

enum class Sensor : std::uint8_t { spd = 0, radar = 1, depth = 2 };
inline constexpr std::size_t sensor_count = 3;
inline constexpr Sensor all_sensors[] = {Sensor::spd, Sensor::radar, Sensor::depth};

// Array with one value per sensor. Its index must be a Sensor, not a number.
template <class T>
struct PerSensor : std::array<T, sensor_count> {
  constexpr T& operator[](Sensor s) { return this->data()[static_cast<std::size_t>(s)]; }
  constexpr const T& operator[](Sensor s) const {
    return this->data()[static_cast<std::size_t>(s)];
  }
};

inline const char* name_of(Sensor s) {
  constexpr PerSensor<const char*> names{"spd", "radar", "depth"};
  return names[s];
}

class SensorSet {
 public:
  constexpr SensorSet() = default;
  constexpr SensorSet(std::initializer_list<Sensor> sensors) {
    for (const Sensor s : sensors) insert(s);
  }
  // `bits`: mask used in files and messages; bit 0 is the SPD, bit 1 the radar, and bit 2 the depth
  // camera.
  static constexpr SensorSet from_bits(std::uint32_t bits) {
    SensorSet set;
    set.bits_ = bits;
    return set;
  }
  constexpr std::uint32_t bits() const { return bits_; }

  constexpr bool contains(Sensor s) const { return bits_ & bit(s); }
  constexpr bool empty() const { return bits_ == 0; }
  constexpr void insert(Sensor s) { bits_ |= bit(s); }
  constexpr void erase(Sensor s) { bits_ &= ~bit(s); }
  // Returns the sensors of this set that are not in `other`.
  constexpr SensorSet operator-(SensorSet other) const { return from_bits(bits_ & ~other.bits_); }
  bool operator==(const SensorSet&) const = default;

 private:
  static constexpr std::uint32_t bit(Sensor s) { return 1u << static_cast<unsigned>(s); }
  std::uint32_t bits_ = 0;
};

}  // namespace echofuse
