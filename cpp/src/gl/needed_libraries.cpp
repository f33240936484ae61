#include "needed_libraries.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>

#include <elf.h>
#include <link.h>

namespace sheetsplat::gl {

namespace {

constexpr std::size_t most_segments = 256, most_entries = 4096, longest_name = 256;
constexpr unsigned char own_class = sizeof(void*) == 8 ? ELFCLASS64 : ELFCLASS32;
constexpr unsigned char own_order = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? ELFDATA2LSB : ELFDATA2MSB;

class File {
  public:
    explicit File(const std::string& path) : stream_(path, std::ios::binary | std::ios::ate) {
        const std::streamoff end = stream_ ? static_cast<std::streamoff>(stream_.tellg()) : 0;
        size_ = end > 0 ? static_cast<std::uint64_t>(end) : 0;
    }

    /// Fills `into` from the file; false where that is not all inside of it.
    template <class T>
    bool read(std::uint64_t at, T* into, std::size_t count) {
        const std::uint64_t bytes = count * sizeof(T);
        if (at > size_ || bytes > size_ - at) {
            return false;
        }
        stream_.seekg(static_cast<std::streamoff>(at));
        stream_.read(reinterpret_cast<char*>(into), static_cast<std::streamsize>(bytes));
        return static_cast<bool>(stream_);
    }

    [[nodiscard]] std::uint64_t left(std::uint64_t at) const { return at < size_ ? size_ - at : 0; }

  private:
    std::ifstream stream_;
    std::uint64_t size_ = 0;
};

bool is_of_this_machine(const ElfW(Ehdr) & header) {
    return std::memcmp(header.e_ident, ELFMAG, SELFMAG) == 0 && header.e_ident[EI_CLASS] == own_class &&
           header.e_ident[EI_DATA] == own_order && header.e_phentsize == sizeof(ElfW(Phdr)) &&
           header.e_phnum <= most_segments;
}

} // namespace

std::vector<std::string> needed_libraries(const std::string& path) {
    File file(path);
    ElfW(Ehdr) header{};
    if (!file.read(0, &header, 1) || !is_of_this_machine(header)) {
        return {};
    }
    std::vector<ElfW(Phdr)> segments(header.e_phnum);
    if (!file.read(header.e_phoff, segments.data(), segments.size())) {
        return {};
    }
    std::vector<ElfW(Dyn)> entries;
    for (const ElfW(Phdr) & segment : segments) {
        if (segment.p_type == PT_DYNAMIC) {
            entries.resize(std::min<std::size_t>(segment.p_filesz / sizeof(ElfW(Dyn)), most_entries));
            if (!file.read(segment.p_offset, entries.data(), entries.size())) {
                return {};
            }
        }
    }
    std::vector<std::uint64_t> needed;
    std::uint64_t table = 0, table_bytes = 0;
    for (const ElfW(Dyn) & entry : entries) {
        if (entry.d_tag == DT_NULL) {
            break;
        }
        if (entry.d_tag == DT_NEEDED) {
            needed.push_back(entry.d_un.d_val);
        } else if (entry.d_tag == DT_STRTAB) {
            table = entry.d_un.d_ptr;
        } else if (entry.d_tag == DT_STRSZ) {
            table_bytes = entry.d_un.d_val;
        }
    }
    // The table's address is one in memory; a segment says where that is in the file.
    const auto holds = [table](const ElfW(Phdr) & segment) {
        return segment.p_type == PT_LOAD && table >= segment.p_vaddr && table - segment.p_vaddr < segment.p_filesz;
    };
    const auto loaded = std::find_if(segments.begin(), segments.end(), holds);
    if (loaded == segments.end()) {
        return {};
    }
    const std::uint64_t start = loaded->p_offset + (table - loaded->p_vaddr);
    table_bytes = std::min(table_bytes, file.left(start));
    std::vector<std::string> names;
    for (const std::uint64_t at : needed) {
        std::array<char, longest_name> text{};
        const auto bytes =
            static_cast<std::size_t>(std::min<std::uint64_t>(text.size(), at < table_bytes ? table_bytes - at : 0));
        if (!file.read(start + at, text.data(), bytes)) {
            continue;
        }
        const auto end = std::find(text.begin(), text.begin() + bytes, '\0');
        if (end != text.begin() && end != text.begin() + bytes) {
            names.emplace_back(text.begin(), end);
        }
    }
    return names;
}

} // namespace sheetsplat::gl
