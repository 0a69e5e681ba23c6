/// @file
/// Reader of the text files for C++ programs: each line has a keyword, then numbers, words or a name.
#pragma once

#include <cctype>
#include <charconv>
#include <cmath>
#include <functional>
#include <istream>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET::detail {

/// Built by appending: gcc 12 warns of overlapping copies where a literal comes first in a sum.
inline std::string quoted(const char* before, const std::string& word, const char* after) {
    std::string text = before;
    text += '\'';
    text += word;
    text += '\'';
    text += after;
    return text;
}

/// A keyword that may appear once, and where its numbers and the name after them are stored.
struct DescriptionField {
    static constexpr double largest = std::numeric_limits<double>::max();

    std::string key;
    double* number = nullptr;
    int count = 0;
    double low = -largest, high = largest;
    std::string wanted = std::to_string(count) + " numbers in its range, once";
    std::function<bool()> valid{};  ///< further condition on the values read
    std::string* name = nullptr;
    bool may_be_missing = false, seen = false;
};

/// The first required field that is missing, or null.
inline const char* missing(const std::vector<DescriptionField>& fields) {
    for (const DescriptionField& field : fields)
        if (!field.seen && !field.may_be_missing) return field.key.c_str();
    return nullptr;
}

/// Reads a text line by line. `error` receives what is wrong with it, with the number of the line.
class DescriptionText {
  public:
    DescriptionText(std::istream& in, std::string& error) : in_(in), error_(error) {}

    std::string keyword;  ///< of the line

    /// Goes to the next line that is no comment and not blank; false at the end of the text.
    bool next() {
        for (std::string line; std::getline(in_, line);) {
            ++number_;
            line_ = std::istringstream(line);
            keyword.clear();
            if (line_ >> keyword && keyword[0] != '#') return true;
        }
        return false;
    }
    /// Sets the error and returns false.
    bool fail(const std::string& what) {
        error_ = "line " + std::to_string(number_) + ": " + what;
        return false;
    }
    /// Nothing is left of the line.
    bool done() {
        return line_.eof() || (line_ >> std::ws).eof() || fail(quoted("", keyword, " is followed by too much"));
    }
    bool numbers(double* values, int count) {
        for (int i = 0; i < count; ++i) {
            std::string token;
            if (!word(token)) return false;
            const char *begin = token.data(), *end = begin + token.size();
            const auto read = std::from_chars(begin, end, values[i]);
            if (read.ec != std::errc() || read.ptr != end || values[i] != values[i]) return false;
        }
        return true;
    }
    bool numbers(double* values, int count, double low, double high) {
        if (!numbers(values, count)) return false;
        for (int i = 0; i < count; ++i)
            if (!(values[i] >= low && values[i] <= high)) return false;
        return true;
    }
    bool finite_numbers(double* values, int count) {
        return numbers(values, count, -DescriptionField::largest, DescriptionField::largest);
    }
    bool word(std::string& value) { return bool(line_ >> value); }
    /// The rest of the line. It may hold blanks, but neither begins nor ends with one, and is not empty.
    bool name(std::string& value) {
        value.clear();
        std::getline(line_ >> std::ws, value);
        while (!value.empty() && std::isspace(static_cast<unsigned char>(value.back()))) value.pop_back();
        return !value.empty();
    }
    /// Reads the line as one of the fields.
    bool read(std::vector<DescriptionField>& fields) {
        for (DescriptionField& field : fields) {
            if (keyword != field.key) continue;
            if (std::exchange(field.seen, true)) return fail(quoted("", keyword, " comes twice"));
            const bool fits = numbers(field.number, field.count, field.low, field.high) &&
                              (!field.name || name(*field.name)) && (!field.valid || field.valid());
            return fits || fail(quoted("", keyword, " wants ") + field.wanted);
        }
        return fail(quoted("unknown keyword ", keyword, ""));
    }

  private:
    std::istream& in_;
    std::string& error_;
    std::istringstream line_;
    int number_ = 0;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET::detail
