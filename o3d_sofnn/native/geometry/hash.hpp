// SPDX-License-Identifier: MIT
// Numbers by integer key: open addressing, keys are not negative.
#pragma once
#include <cstdint>
#include <vector>

namespace sofnn {

class KeyMap {
 public:
  KeyMap() : slots_(1 << 10, Slot{-1, 0}) {}

  int64_t size() const { return size_; }

  std::vector<int64_t> keys() const {
    std::vector<int64_t> result;
    for (const Slot& s : slots_)
      if (s.key >= 0) result.push_back(s.key);
    return result;
  }

  // The value of a key; -1 where it is missing.
  int64_t find(int64_t key) const {
    for (uint64_t i = place(key);; i = (i + 1) & (slots_.size() - 1)) {
      if (slots_[i].key == key) return slots_[i].value;
      if (slots_[i].key < 0) return -1;
    }
  }

  // The value that a key has already, or the one given, which it has from now on.
  int64_t insert(int64_t key, int64_t value) {
    if (4 * (size_ + 1) > 3 * static_cast<int64_t>(slots_.size())) grow();
    for (uint64_t i = place(key);; i = (i + 1) & (slots_.size() - 1)) {
      if (slots_[i].key == key) return slots_[i].value;
      if (slots_[i].key < 0) {
        slots_[i] = {key, value}, ++size_;
        return value;
      }
    }
  }

 private:
  struct Slot {
    int64_t key, value;
  };
  std::vector<Slot> slots_;
  int64_t size_ = 0;

  uint64_t place(int64_t key) const {
    uint64_t h = static_cast<uint64_t>(key) * 0x9e3779b97f4a7c15ull;
    return (h ^ h >> 32) & (slots_.size() - 1);
  }

  void grow() {
    std::vector<Slot> old(2 * slots_.size(), Slot{-1, 0});
    old.swap(slots_);
    for (const Slot& s : old)
      if (s.key >= 0) {
        uint64_t i = place(s.key);
        while (slots_[i].key >= 0) i = (i + 1) & (slots_.size() - 1);
        slots_[i] = s;
      }
  }
};

}  // namespace sofnn
