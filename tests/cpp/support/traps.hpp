// Floating-point exceptions as failures.
#pragma once

#include <cfenv>

#include <gtest/gtest.h>

namespace sheetsplat::test {

/// Floating-point exceptions stop the program while one lives.
class Traps {
  public:
    Traps() {
        std::feclearexcept(FE_ALL_EXCEPT);
#ifdef __GLIBC__
        feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
#endif
    }
    ~Traps() {
#ifdef __GLIBC__
        fedisableexcept(FE_ALL_EXCEPT);
#endif
        EXPECT_EQ(std::fetestexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW), 0);
    }
    Traps(const Traps&) = delete;
    Traps& operator=(const Traps&) = delete;
};

} // namespace sheetsplat::test
