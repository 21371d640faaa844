// SPDX-License-Identifier: MIT
// Fixed chunks handed to threads: what is computed for an index never depends on the number of threads. Where the
// system starts fewer of them, these do all of the work, the calling thread alone at last. What a chunk throws is
// thrown in the calling thread, when all threads have ended.
#pragma once
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

namespace sofnn {

// As many of some threads as there is memory for. A thread takes a stack (8 MiB), a heap (64 MiB) and what it needs to
// throw; the process ends, without a word to the caller, where it finds none of the last.
inline int with_room(int threads) {
  constexpr size_t kRoom = size_t{80} << 20;
  while (threads > 1) {
    void* volatile room = std::malloc((threads - 1) * kRoom);  // volatile, or the calls are left out
    std::free(room);
    if (room != nullptr) break;
    threads = (threads + 1) / 2;
  }
  return threads;
}

template <class Body>
void parallel_for(int64_t n, int64_t chunk, int threads, const Body& body) {
  const int64_t chunks = (n + chunk - 1) / chunk;
  threads = with_room(static_cast<int>(std::min<int64_t>(std::max(threads, 1), chunks)));
  if (threads <= 1) {
    for (int64_t c = 0; c < chunks; ++c) body(c * chunk, std::min(n, (c + 1) * chunk));
    return;
  }
  std::atomic<int64_t> next{0};
  std::exception_ptr error;
  std::mutex error_mutex;
  auto work = [&] {
    const volatile int thrown = std::uncaught_exceptions();  // takes what throwing needs; volatile, as above
    static_cast<void>(thrown);
    try {
      for (int64_t c = next++; c < chunks; c = next++) body(c * chunk, std::min(n, (c + 1) * chunk));
    } catch (...) {
      std::lock_guard<std::mutex> lock(error_mutex);
      error = std::current_exception();
      next = chunks;
    }
  };
  std::vector<std::thread> pool;
  try {
    pool.reserve(threads - 1);
    for (int t = 1; t < threads; ++t) pool.emplace_back(work);
  } catch (const std::system_error&) {  // no more threads
  } catch (const std::bad_alloc&) {     // no memory for one
  }
  work();
  for (auto& thread : pool) thread.join();
  if (error) std::rethrow_exception(error);
}

}  // namespace sofnn
