// Whether two scenes make the same picture from everywhere.
#pragma once

#include <vector>

#include "sheetsplat/scene.hpp"

namespace sheetsplat {

[[nodiscard]] bool same(const std::vector<TransferPoint>& a, const std::vector<TransferPoint>& b);
[[nodiscard]] bool same(const Clip& a, const Clip& b);
/// Fields count as the same where they are one object.
[[nodiscard]] bool same(const Scene& a, const Scene& b);

} // namespace sheetsplat
