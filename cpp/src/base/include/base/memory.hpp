// Sizes that are checked before memory is taken.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "sheetsplat/error.hpp"

namespace sheetsplat {

/// Bytes that this process may still take: the least of free physical memory and the limits set on it.
/// 2^64 - 1 where the system does not tell.
std::uint64_t available_memory();

/// The part of available_memory() that is read from files below `proc` (usually /proc): MemAvailable of meminfo, and
/// the limits minus usage of every control group (versions 1 and 2) that self/cgroup and self/mountinfo lead to. 2^64 -
/// 1 where they do not tell.
std::uint64_t available_memory_in(const std::string& proc);

/// The limit on this process's address space less what is used of it; 2^64 - 1 where there is none.
std::uint64_t available_address_space();

/// a * b, or OutOfMemory that names `what` where it does not fit 64 bits.
std::uint64_t checked_product(std::uint64_t a, std::uint64_t b, const std::string& what);

/// Throws OutOfMemory where `bytes` for `what` are more than available_memory(); `advice` says what the user can do.
void require_memory(std::uint64_t bytes, const std::string& what, const Words& advice);

} // namespace sheetsplat
