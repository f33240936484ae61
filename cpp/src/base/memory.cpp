#include "base/memory.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <vector>

#include "base/checks.hpp"

namespace sheetsplat {
namespace {

constexpr std::uint64_t unlimited = std::numeric_limits<std::uint64_t>::max();

std::optional<std::uint64_t> read_number(const std::string& path) {
    std::ifstream file(path);
    std::uint64_t number = 0;
    if (file >> number) {
        return number;
    }
    return std::nullopt;
}

/// The number behind `name` in a file of lines "name number ...".
std::optional<std::uint64_t> read_entry(const std::string& path, const std::string& name) {
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);) {
        std::istringstream words(line);
        std::string word;
        std::uint64_t number = 0;
        if (words >> word && word == name && words >> number) {
            return number;
        }
    }
    return std::nullopt;
}

struct GroupFiles {
    const char* limit;
    const char* usage;
    const char* reclaimable;
};
constexpr GroupFiles version_1{"memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"};
constexpr GroupFiles version_2{"memory.max", "memory.current", "inactive_file"};

std::uint64_t left_in_group(const std::string& folder, const GroupFiles& files) {
    const auto limit = read_number(folder + "/" + files.limit);
    const auto usage = read_number(folder + "/" + files.usage);
    if (!limit || !usage) {
        return unlimited;
    }
    // Cached file pages count as usage, but the kernel gives them up before it refuses memory.
    const std::uint64_t reclaimable = read_entry(folder + "/memory.stat", files.reclaimable).value_or(0);
    const std::uint64_t held = *usage - std::min(*usage, reclaimable);
    return *limit - std::min(*limit, held);
}

/// The least that is left in a group and all groups around it, up to the folder where the hierarchy is mounted.
std::uint64_t left_in_groups(const std::string& mount, std::string group, const GroupFiles& files) {
    std::uint64_t least = unlimited;
    while (!group.empty() && group != "/") {
        least = std::min(least, left_in_group(mount + group, files));
        group.resize(group.find_last_of('/'));
    }
    return std::min(least, left_in_group(mount, files));
}

struct Mount {
    std::string root; ///< the group that is seen at `point`
    std::string point;
    bool second_version = false;
};

/// Where control groups that know of memory are mounted (proc(5): fields of mountinfo).
std::vector<Mount> group_mounts(const std::string& proc) {
    std::vector<Mount> result;
    std::ifstream file(proc + "/self/mountinfo");
    for (std::string line; std::getline(file, line);) {
        const std::size_t dash = line.find(" - ");
        if (dash == std::string::npos) {
            continue;
        }
        std::istringstream before(line.substr(0, dash));
        std::istringstream after(line.substr(dash + 3));
        std::string id, parent, device, type, source, options;
        Mount mount;
        before >> id >> parent >> device >> mount.root >> mount.point;
        after >> type >> source >> options;
        mount.second_version = type == "cgroup2";
        if (mount.second_version || (type == "cgroup" && ("," + options + ",").find(",memory,") != std::string::npos)) {
            result.push_back(mount);
        }
    }
    return result;
}

std::uint64_t left_in_control_groups(const std::string& proc) {
    const std::vector<Mount> mounts = group_mounts(proc);
    std::uint64_t least = unlimited;
    std::ifstream file(proc + "/self/cgroup");
    for (std::string line; std::getline(file, line);) {
        const std::size_t first = line.find(':');
        const std::size_t second = line.find(':', first == std::string::npos ? first : first + 1);
        if (second == std::string::npos) {
            continue;
        }
        const std::string controllers = line.substr(first + 1, second - first - 1);
        const std::string path = line.substr(second + 1);
        const bool second_version = controllers.empty();
        if (!second_version && ("," + controllers + ",").find(",memory,") == std::string::npos) {
            continue;
        }
        for (const Mount& mount : mounts) {
            if (mount.second_version != second_version || path.empty() || path.front() != '/') {
                continue;
            }
            // In a container the mount's root is often the process's own group: only what lies below it is a folder
            // here.
            const std::string root = mount.root == "/" ? "" : mount.root;
            const bool below = path.compare(0, root.size(), root) == 0;
            least = std::min(least, left_in_groups(mount.point, below ? path.substr(root.size()) : std::string(),
                                                   second_version ? version_2 : version_1));
        }
    }
    return least;
}

} // namespace

std::uint64_t available_address_space() {
    rlimit limit{};
    if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) {
        return unlimited;
    }
    const std::uint64_t pages = read_number("/proc/self/statm").value_or(0);
    const std::uint64_t used = pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
    const std::uint64_t allowed = limit.rlim_cur;
    return allowed - std::min(allowed, used);
}

std::uint64_t available_memory_in(const std::string& proc) {
    std::uint64_t least = left_in_control_groups(proc);
    if (const auto free_kib = read_entry(proc + "/meminfo", "MemAvailable:")) {
        least = std::min(least, *free_kib * 1024);
    }
    return least;
}

std::uint64_t available_memory() { return std::min(available_memory_in("/proc"), available_address_space()); }

std::uint64_t checked_product(std::uint64_t a, std::uint64_t b, const std::string& what) {
    if (b != 0 && a > std::numeric_limits<std::uint64_t>::max() / b) {
        throw OutOfMemory(Complaint{"no memory for " + what, text_of_count(a) + " times " + text_of_count(b),
                                    "a product below 2^64", "ask for less"});
    }
    return a * b;
}

void require_memory(std::uint64_t bytes, const std::string& what, const Words& advice) {
    const std::uint64_t available = available_memory();
    if (bytes > available) {
        throw OutOfMemory(Complaint{"no memory for " + what,
                                    text_of_bytes(available) + " that this process may still take",
                                    text_of_bytes(bytes), advice});
    }
}

} // namespace sheetsplat
