#pragma once

#include <memory>

#include "base/result.h"
#include "dataset/image_source.h"
#include "dataset/media_module.h"

/// The kinds of sources that OpenImageSource() chooses from; only this folder includes it.
namespace portolan {

/// @param camera the calibration; a size of 0 is filled in from the first image.
Result<std::unique_ptr<ImageSource>> OpenFolderSource(const SourceOptions& options, DatasetLayout layout,
                                                      const CameraModel& camera);
Result<std::unique_ptr<ImageSource>> OpenVideoSource(const SourceOptions& options, const CameraModel& camera);
Result<std::unique_ptr<ImageSource>> OpenCameraSource(const SourceOptions& options, const CameraModel& camera);
/// The same with a stream, which may not be open, in place of the one that libportolan_media.so opens.
Result<std::unique_ptr<ImageSource>> OpenCameraSource(const SourceOptions& options, const CameraModel& camera,
                                                      std::unique_ptr<VideoStream> capture);

/// Takes over the size of the source's images into a calibration without one; fails, naming `image`, if the two differ
/// or the camera is not valid.
Status AdoptImageSize(const std::string& image, cv::Size size, CameraModel* camera);

/// Fails, naming `image`, if it is not of the camera's size.
Status CheckImageSize(const std::string& image, cv::Size size, const CameraModel& camera);

}  // namespace portolan
