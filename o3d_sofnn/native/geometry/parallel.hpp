// SPDX-License-Identifier: MIT
// Fixed chunks handed to threads: what is computed for an index never depends on the number of threads. Where the
// system starts fewer of them, these do all of the work, the calling thread alone at last. What a chunk throws is
// thrown in the calling thread, when all threads have ended.
#pragma once
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <exception>
#include <new>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace sofnn {

template <class Body>
void parallel_for(int64_t n, int64_t chunk, int threads, const Body& body) {
  const int64_t chunks = (n + chunk - 1) / chunk;
  threads = static_cast<int>(std::min<int64_t>(std::max(threads, 1), chunks));
  if (threads <= 1) {
    for (int64_t c = 0; c < chunks; ++c) body(c * chunk, std::min(n, (c + 1) * chunk));
    return;
  }
  std::atomic<int64_t> next{0};
  std::exception_ptr error;
  std::mutex error_mutex;
  auto work = [&] {
    try {
      for (int64_t c = next++; c < chunks; c = next++) body(c * chunk, std::min(n, (c + 1) * chunk));
    } catch (...) {
      std::lock_guard<std::mutex> lock(error_mutex);
      error = std::current_exception();
      next = chunks;
    }
  };
  std::vector<std::thread> pool;
  pool.reserve(threads - 1);
  try {
    for (int t = 1; t < threads; ++t) pool.emplace_back(work);
  } catch (const std::system_error&) {  // no more threads, or no memory for one
  } catch (const std::bad_alloc&) {
  }
  work();
  for (auto& thread : pool) thread.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace sofnn
