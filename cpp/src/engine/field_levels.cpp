#include "field_levels.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

#include "base/memory.hpp"
#include "field/lattice_frame.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Along an axis with fewer blocks the field's borders would show.
constexpr std::size_t least_blocks = 8;

/// Samples of an axis in a block that is not longer than `length`, distances of samples.
std::size_t block_along(std::size_t samples, double length) {
    std::size_t block = 1;
    while (2.0 * static_cast<double>(block) <= length && samples / (2 * block) >= least_blocks) {
        block *= 2;
    }
    return block;
}

std::size_t blocks_along(std::size_t samples, std::size_t block) { return (samples + block - 1) / block; }

std::array<std::size_t, 3> shape_of(const RegularField& field, const LevelBlock& block) {
    const auto [nk, nj, ni] = field.shape();
    return {blocks_along(nk, block[2]), blocks_along(nj, block[1]), blocks_along(ni, block[0])};
}

/// Sums and counts of the samples of one row of blocks.
struct BlockRow {
    std::vector<double> sums;
    std::vector<std::size_t> counts;

    template <class T>
    void add(const T* samples, std::size_t count, std::size_t block) {
        for (std::size_t i = 0; i < sums.size(); ++i) {
            const T* end = samples + std::min(block, count - i * block);
            double sum = 0.0;
            std::size_t holes = 0;
            for (const T* sample = samples; sample != end; ++sample) {
                if constexpr (std::is_floating_point_v<T>) {
                    if (std::isnan(*sample)) {
                        ++holes;
                        continue;
                    }
                }
                sum += static_cast<double>(*sample);
            }
            sums[i] += sum;
            counts[i] += static_cast<std::size_t>(end - samples) - holes;
            samples = end;
        }
    }
};

/// present: the mean is that of the samples which are there; else what is missing counts as the base, so that blocks
/// keep the sum of their samples.
template <class T>
std::vector<T> means(const std::vector<T>& samples, const RegularField& field, const LevelBlock& block,
                     const std::array<std::size_t, 3>& blocks, bool present, const std::function<void()>& poll) {
    const auto [nk, nj, ni] = field.shape();
    std::vector<T> result;
    result.reserve(blocks[0] * blocks[1] * blocks[2]);
    const auto whole = static_cast<double>(block[0] * block[1] * block[2]);
    BlockRow row;
    for (std::size_t k = 0; k < nk; k += block[2]) {
        poll();
        for (std::size_t j = 0; j < nj; j += block[1]) {
            row.sums.assign(blocks[2], 0.0);
            row.counts.assign(blocks[2], 0);
            for (std::size_t layer = k; layer < std::min(k + block[2], nk); ++layer) {
                for (std::size_t line = j; line < std::min(j + block[1], nj); ++line) {
                    row.add(samples.data() + field.row(line, layer), ni, block[0]);
                }
            }
            for (std::size_t i = 0; i < blocks[2]; ++i) {
                const auto count = static_cast<double>(row.counts[i]);
                const double sum = row.sums[i] - count * field.counted_from();
                const double mean = sum / (present ? count : whole) + field.base();
                if constexpr (std::is_floating_point_v<T>) {
                    result.push_back(row.counts[i] == 0 ? std::numeric_limits<T>::quiet_NaN() : static_cast<T>(mean));
                } else {
                    result.push_back(static_cast<T>(std::lround(mean)));
                }
            }
        }
    }
    return result;
}

std::shared_ptr<const Field> field_of_blocks(const RegularField& field, const LevelBlock& block,
                                             const std::function<void()>& poll) {
    const std::array<std::size_t, 3> blocks = shape_of(field, block);
    RegularFieldOptions options = field.options();
    options.prefilter = false;
    options.value_range.reset();
    options.normalization = field.normalization();
    options.w0 = field.w0();
    options.least_weight = field.least_weight();
    options.domain = field.domain();
    for (int axis = 0; axis < 3; ++axis) {
        const auto count = static_cast<double>(block[static_cast<std::size_t>(axis)]);
        options.origin += 0.5 * (count - 1.0) * field.steps()[axis];
        options.spacing[axis] *= count;
        if (options.axes) {
            (*options.axes)[axis] *= count;
        }
    }
    const bool present = field.normalization() == Normalization::threshold || field.domain();
    return std::visit(
        [&](const auto& samples) -> std::shared_ptr<const Field> {
            using T = typename std::decay_t<decltype(samples)>::value_type;
            require_memory(checked_product(blocks[0] * blocks[1] * blocks[2], sizeof(T), "a volume of fewer samples"),
                           "a volume of fewer samples", "use a smaller volume");
            return std::make_shared<const RegularField>(means(samples, field, block, blocks, present, poll), blocks,
                                                        options);
        },
        field.samples());
}

} // namespace

Level level_of(const Scene& scene, double pixel_world, bool whole) {
    Level level;
    double kernels = 0.0, left = 0.0;
    level.slice_spacing = std::numeric_limits<double>::infinity();
    for (const auto& field : scene.fields) {
        LevelBlock block{1, 1, 1};
        const RegularField* regular = as_regular(field.get());
        auto count = static_cast<double>(field->size());
        kernels += count;
        double spacing = field->default_slice_spacing();
        if (regular != nullptr && regular->lattice() == Lattice::cartesian && !whole) {
            const Vec3 distance = regular->options().axes ? heights(regular->steps()) : regular->options().spacing;
            spacing = std::numeric_limits<double>::infinity();
            for (int axis = 0; axis < 3; ++axis) {
                const auto a = static_cast<std::size_t>(axis);
                block[a] = block_along(regular->shape()[2 - a], pixel_world / distance[axis]);
                spacing = std::min(spacing, static_cast<double>(block[a]) * distance[axis]);
            }
            count /= static_cast<double>(block[0] * block[1] * block[2]);
        }
        left += count;
        level.blocks.push_back(block);
        if (field->size() != 0) {
            level.slice_spacing = std::min(level.slice_spacing, spacing);
        }
    }
    if (level.slice_spacing == std::numeric_limits<double>::infinity()) {
        level.slice_spacing = scene.default_slice_spacing();
    }
    level.fewer = left > 0.0 ? kernels / left : 1.0;
    return level;
}

std::vector<std::shared_ptr<const Field>> FieldLevels::of(const std::vector<std::shared_ptr<const Field>>& fields,
                                                          const Level& level, const std::function<void()>& poll) {
    std::vector<std::shared_ptr<const Field>> result;
    for (std::size_t number = 0; number < fields.size(); ++number) {
        const std::shared_ptr<const Field>& field = fields[number];
        const LevelBlock& block = level.blocks[number];
        if (block == LevelBlock{1, 1, 1}) {
            result.push_back(field);
            continue;
        }
        auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.source == field && entry.block == block; });
        if (found == entries_.end()) {
            std::shared_ptr<const Field> made = field;
            try {
                made = field_of_blocks(*as_regular(field.get()), block, poll);
            } catch (const OutOfMemory&) {
                // A picture of the field itself takes longer, and no more memory.
            }
            entries_.push_back({field, block, std::move(made)});
            found = entries_.end() - 1;
        }
        result.push_back(found->field);
    }
    return result;
}

bool FieldLevels::made(const std::shared_ptr<const Field>& field) const {
    return std::any_of(entries_.begin(), entries_.end(),
                       [&](const Entry& entry) { return entry.field == field && entry.source != field; });
}

std::vector<std::shared_ptr<const Field>> FieldLevels::keep(const Scene& scene) {
    std::vector<std::shared_ptr<const Field>> result;
    for (const auto& field : scene.fields) {
        // Of a scene of blocks its sources count, whose other levels are kept as well.
        const auto found =
            std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.field == field; });
        result.push_back(found == entries_.end() ? field : found->source);
    }
    const auto unused = [&](const Entry& entry) {
        return std::find(result.begin(), result.end(), entry.source) == result.end();
    };
    entries_.erase(std::remove_if(entries_.begin(), entries_.end(), unused), entries_.end());
    for (const Entry& entry : entries_) {
        result.push_back(entry.field);
    }
    return result;
}

} // namespace sheetsplat
