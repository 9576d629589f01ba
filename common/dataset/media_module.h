#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>

// What libportolan_media.so offers. OpenCV's codecs bring over two hundred libraries and 55 MB of relocated tables into
// a process (GDAL, FFmpeg, GStreamer); a program that reads JPEG and PNG files needs none of them, so they stand behind
// dlopen (media_library.h).

namespace portolan {

/// A video file or a camera, as cv::VideoCapture; see there. Numbers of properties and backends are OpenCV's.
class VideoStream {
 public:
  virtual ~VideoStream() = default;
  virtual bool IsOpened() const = 0;
  virtual bool Grab() = 0;
  virtual bool Retrieve(cv::Mat* picture) = 0;
  virtual double Get(int property) const = 0;
  virtual void Set(int property, double value) = 0;
};

struct MediaModule {
  /// Any format that OpenCV reads, as CV_8UC1. @return false with the problem in words; empty words: it is no image.
  bool (*decode_grey)(const uint8_t* bytes, size_t size, cv::Mat* grey, std::string* problem);
  /// A stream that may not be open. @param backend one of cv::VideoCaptureAPIs.
  std::unique_ptr<VideoStream> (*open_video)(const std::string& path, int backend);
};

/// The one symbol of the library: returns its MediaModule.
constexpr const char* kMediaModuleSymbol = "PortolanMediaModule";

}  // namespace portolan
