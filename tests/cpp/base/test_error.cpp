#include <string>
#include <type_traits>

#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

TEST(Complaint, joins_its_fields) {
    const Complaint complaint{"RegularField: the samples cannot be used", "NaN at sample (3, 0, 7)", "finite numbers",
                              "pass " + option_ref("nan", "skip") + " to leave such samples out", "nan"};
    EXPECT_EQ(complaint.text(), "RegularField: the samples cannot be used: found NaN at sample (3, 0, 7); "
                                "wanted finite numbers; pass nan = skip to leave such samples out");
    const auto as_flag = [](const OptionRef& option) { return "--" + option.name + " " + option.value; };
    EXPECT_EQ(complaint.advice.text(as_flag), "pass --nan skip to leave such samples out");
    EXPECT_EQ(complaint.words().text(as_flag), complaint.text(as_flag));
}

TEST(Words, are_joined_piece_by_piece) {
    const Words words = std::string("use ") + option_ref("backend", "cpu") + " or " + option_ref("max_error");
    EXPECT_EQ(words.pieces().size(), 4U);
    EXPECT_EQ(words.text(), "use backend = cpu or max_error");
    EXPECT_EQ(words.text([](const OptionRef& option) { return "[" + option.name + "]"; }),
              "use [backend] or [max_error]");
    EXPECT_TRUE(Words("").empty());
    EXPECT_TRUE((Words() + "").empty());
    Words twice = words;
    twice += twice;
    EXPECT_EQ(twice.text(), words.text() + words.text());
}

TEST(Complaint, leaves_empty_parts_out) {
    EXPECT_EQ((Complaint{"it failed", "", "", ""}.text()), "it failed");
    EXPECT_EQ((Complaint{"it failed", "3", "", ""}.text()), "it failed: found 3");
    EXPECT_EQ((Complaint{"it failed", "", "4", ""}.text()), "it failed: wanted 4");
    EXPECT_EQ((Complaint{"it failed", "", "", "try again"}.text()), "it failed: try again");
    EXPECT_EQ((Complaint{"", "3", "4", ""}.text()), "found 3; wanted 4");
    EXPECT_EQ((Complaint{}.text()), "");
}

TEST(Error, carries_its_fields_and_can_be_told_apart) {
    const Complaint complaint{"it failed", "3", "4", "leave " + option_ref("max_error") + " out", "max_error"};
    try {
        throw InvalidInput(complaint);
    } catch (const Error& error) {
        EXPECT_STREQ(error.what(), "it failed: found 3; wanted 4; leave max_error out");
        EXPECT_EQ(error.complaint().what.text(), "it failed");
        EXPECT_EQ(error.complaint().found.text(), "3");
        EXPECT_EQ(error.complaint().wanted.text(), "4");
        EXPECT_EQ(error.complaint().advice.text(), "leave max_error out");
        EXPECT_EQ(error.complaint().option, "max_error");
        EXPECT_NE(dynamic_cast<const InvalidInput*>(&error), nullptr);
        EXPECT_EQ(dynamic_cast<const OutOfMemory*>(&error), nullptr);
    }
    EXPECT_THROW(throw DeviceUnavailable(complaint), std::runtime_error);
    EXPECT_FALSE(Cancelled().complaint().what.empty());
    static_assert(std::is_nothrow_copy_constructible_v<Unsupported>);
}

} // namespace
} // namespace sheetsplat
