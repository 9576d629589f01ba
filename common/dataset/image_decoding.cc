#include "dataset/image_decoding.h"

#include <csetjmp>
#include <cstdio>  // jpeglib.h needs it
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <jpeglib.h>
#include <png.h>

#include "dataset/media_library.h"

namespace portolan {
namespace {

constexpr std::string_view kJpegStart = "\xff\xd8\xff";
constexpr std::string_view kPngStart = "\x89PNG\r\n\x1a\n";
constexpr std::string_view kExifMark("Exif\0\0", 6);
// A header of a few bytes may claim any size, and the pixels are there before it turns out that nothing comes of them.
constexpr uint32_t kMaxSide = 1 << 14;
constexpr uint64_t kMaxPixels = uint64_t{1} << 25;  // 33 megapixels

bool IsTooLarge(uint64_t width, uint64_t height) {
  return width > kMaxSide || height > kMaxSide || width * height > kMaxPixels;
}

// The C libraries leave by longjmp: what is between setjmp and the calls has no destructors.

struct JpegFailure {
  jpeg_error_mgr manager;  // first: the library knows only this part
  std::jmp_buf back;
  char text[JMSG_LENGTH_MAX];
};

[[noreturn]] void LeaveJpeg(j_common_ptr decoder) {
  auto* failure = reinterpret_cast<JpegFailure*>(decoder->err);
  failure->manager.format_message(decoder, failure->text);
  std::longjmp(failure->back, 1);
}

void IgnoreJpegWarning(j_common_ptr, int) {}

enum class Outcome { kDone, kFailed, kTooLarge, kOther };

/// @param header_only whether to leave all but the size to others. @param grey gets the size; its pixels must not move
/// while the decoder lives.
Outcome RunJpeg(const uint8_t* bytes, size_t size, bool header_only, jpeg_decompress_struct* decoder,
                JpegFailure* failure, cv::Mat* grey) {
  if (setjmp(failure->back) != 0) return Outcome::kFailed;
  jpeg_create_decompress(decoder);
  jpeg_mem_src(decoder, bytes, size);
  jpeg_read_header(decoder, TRUE);
  if (IsTooLarge(decoder->image_width, decoder->image_height)) return Outcome::kTooLarge;
  if (header_only || decoder->num_components == 4) return Outcome::kOther;
  decoder->out_color_space = JCS_GRAYSCALE;
  decoder->out_color_components = 1;
  jpeg_start_decompress(decoder);
  grey->create(static_cast<int>(decoder->output_height), static_cast<int>(decoder->output_width), CV_8UC1);
  while (decoder->output_scanline < decoder->output_height) {
    JSAMPROW row = grey->ptr(static_cast<int>(decoder->output_scanline));
    jpeg_read_scanlines(decoder, &row, 1);
  }
  jpeg_finish_decompress(decoder);
  return Outcome::kDone;
}

Error TooLarge(uint64_t width, uint64_t height) {
  return Error{"is " + std::to_string(width) + " x " + std::to_string(height) + " pixels, expected sides of at most " +
               std::to_string(kMaxSide) + " and " + std::to_string(kMaxPixels) + " pixels in all"};
}

/// None: to be read by others.
std::optional<Result<cv::Mat>> DecodeJpeg(const uint8_t* bytes, size_t size, bool header_only) {
  jpeg_decompress_struct decoder{};
  JpegFailure failure{};
  decoder.err = jpeg_std_error(&failure.manager);
  failure.manager.error_exit = LeaveJpeg;
  failure.manager.emit_message = IgnoreJpegWarning;
  cv::Mat grey;
  const Outcome outcome = RunJpeg(bytes, size, header_only, &decoder, &failure, &grey);
  const uint64_t width = decoder.image_width, height = decoder.image_height;
  jpeg_destroy_decompress(&decoder);
  if (outcome == Outcome::kTooLarge) return Result<cv::Mat>(TooLarge(width, height));
  if (outcome == Outcome::kOther) return std::nullopt;
  if (outcome == Outcome::kFailed) return Result<cv::Mat>(Error{std::string("can't be decoded: ") + failure.text});
  return Result<cv::Mat>(grey);
}

struct PngInput {
  const uint8_t* next;
  size_t left;
  std::jmp_buf back;
  char text[128];
  bool is_too_large;
};

[[noreturn]] void LeavePng(png_structp decoder, png_const_charp message) {
  auto* input = static_cast<PngInput*>(png_get_error_ptr(decoder));
  std::snprintf(input->text, sizeof input->text, "%s", message);
  std::longjmp(input->back, 1);
}

void IgnorePngWarning(png_structp, png_const_charp) {}

void ReadPngBytes(png_structp decoder, png_bytep out, size_t size) {
  auto* input = static_cast<PngInput*>(png_get_io_ptr(decoder));
  if (size > input->left) png_error(decoder, "the data ends early");
  std::memcpy(out, input->next, size);
  input->next += size;
  input->left -= size;
}

/// @param rows gets a pointer to each row of `grey`; both belong to the caller.
bool RunPng(png_structp decoder, png_infop info, PngInput* input, cv::Mat* grey, std::vector<uint8_t*>* rows) {
  if (setjmp(input->back) != 0) return false;
  png_set_read_fn(decoder, input, ReadPngBytes);
  png_read_info(decoder, info);
  if (IsTooLarge(png_get_image_width(decoder, info), png_get_image_height(decoder, info))) {
    input->is_too_large = true;
    return false;
  }
  const int colour = png_get_color_type(decoder, info);
  png_set_strip_16(decoder);
  png_set_strip_alpha(decoder);
  if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(decoder);
  if ((colour & PNG_COLOR_MASK_COLOR) == 0) png_set_expand_gray_1_2_4_to_8(decoder);
  if ((colour & PNG_COLOR_MASK_COLOR) != 0) png_set_rgb_to_gray(decoder, PNG_ERROR_ACTION_NONE, 0.299, 0.587);
  png_set_interlace_handling(decoder);
  png_read_update_info(decoder, info);
  grey->create(static_cast<int>(png_get_image_height(decoder, info)),
               static_cast<int>(png_get_image_width(decoder, info)), CV_8UC1);
  if (png_get_rowbytes(decoder, info) != static_cast<size_t>(grey->cols))
    png_error(decoder, "rows are not of one byte a pixel");
  for (int y = 0; y < grey->rows; ++y) rows->push_back(grey->ptr(y));
  png_read_image(decoder, rows->data());
  png_read_end(decoder, info);
  return true;
}

Result<cv::Mat> DecodePng(const uint8_t* bytes, size_t size) {
  PngInput input{bytes, size, {}, {}, false};
  png_structp decoder = png_create_read_struct(PNG_LIBPNG_VER_STRING, &input, LeavePng, IgnorePngWarning);
  if (decoder == nullptr) return Error{"libpng is of another version"};
  png_infop info = png_create_info_struct(decoder);
  cv::Mat grey;
  std::vector<uint8_t*> rows;
  const bool decoded = info != nullptr && RunPng(decoder, info, &input, &grey, &rows);
  const uint64_t width = png_get_image_width(decoder, info), height = png_get_image_height(decoder, info);
  png_destroy_read_struct(&decoder, &info, nullptr);
  if (input.is_too_large) return TooLarge(width, height);
  if (!decoded) return Error{std::string("can't be decoded: ") + input.text};
  return grey;
}

Result<cv::Mat> DecodeOther(const uint8_t* bytes, size_t size) {
  const auto module = LoadMediaModule();
  if (!module) return module.error();
  cv::Mat grey;
  std::string problem;
  if ((*module)->decode_grey(bytes, size, &grey, &problem)) return grey;
  return Error{problem.empty() ? "is not an image that can be decoded" : "can't be decoded: " + problem};
}

/// EXIF stands in one of the first segments.
bool HasExif(std::string_view bytes) {
  return bytes.substr(0, 4096).find(kExifMark) != std::string_view::npos;
}

}  // namespace

Result<cv::Mat> DecodeGrey(const uint8_t* bytes, size_t size) {
  const std::string_view all(reinterpret_cast<const char*>(bytes), size);
  if (all.substr(0, kPngStart.size()) == kPngStart) return DecodePng(bytes, size);
  if (all.substr(0, kJpegStart.size()) == kJpegStart) {
    if (auto decoded = DecodeJpeg(bytes, size, HasExif(all))) return *decoded;
  }
  return DecodeOther(bytes, size);
}

}  // namespace portolan
