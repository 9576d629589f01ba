#include "map/keyframe_view.h"

namespace portolan {

KeyFrameView::KeyFrameView(const KeyFrame& keyframe)
    : keyframe_(keyframe),
      projection_(keyframe.data->camera, keyframe.data->pyramid, keyframe.camera_from_map),
      scales_(keyframe.data->pyramid.Scales()),
      sigmas_(keyframe.data->pyramid.Sigmas()) {}

}  // namespace portolan
