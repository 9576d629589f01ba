#include "dataset/media_module.h"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

namespace portolan {
namespace {

class CvVideoStream : public VideoStream {
 public:
  CvVideoStream(const std::string& path, int backend) : capture_(path, backend) {}
  bool IsOpened() const override { return capture_.isOpened(); }
  bool Grab() override { return capture_.grab(); }
  bool Retrieve(cv::Mat* picture) override { return capture_.retrieve(*picture); }
  double Get(int property) const override { return capture_.get(property); }
  void Set(int property, double value) override { capture_.set(property, value); }

 private:
  cv::VideoCapture capture_;
};

bool DecodeWithOpenCv(const uint8_t* bytes, size_t size, cv::Mat* grey, std::string* problem) {
  try {
    const cv::Mat buffer(1, static_cast<int>(size), CV_8UC1, const_cast<uint8_t*>(bytes));  // read only
    *grey = cv::imdecode(buffer, cv::IMREAD_GRAYSCALE);
  } catch (const cv::Exception& failure) {
    *problem = failure.what();
    return false;
  }
  return !grey->empty();
}

std::unique_ptr<VideoStream> OpenWithOpenCv(const std::string& path, int backend) {
  return std::make_unique<CvVideoStream>(path, backend);
}

constexpr MediaModule kModule{DecodeWithOpenCv, OpenWithOpenCv};

}  // namespace
}  // namespace portolan

extern "C" __attribute__((visibility("default"))) const portolan::MediaModule* PortolanMediaModule() {
  return &portolan::kModule;
}
