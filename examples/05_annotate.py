"""Lines, a magnified deck and needles drawn on a picture of your own program.

    python examples/05_annotate.py RECORDING [INDEX] [PICTURE]

RECORDING is anything `deckline run` takes; `deckline demo` unpacks one into demo-out/approach.
"""

import sys

from PIL import Image

from deckline import Flight, open_recording
from deckline.dehaze import dehaze_frame
from deckline.report.annotators import LineAnnotator, MagnifierAnnotator, NeedleAnnotator


def main(recording: str, index: str = "0", picture: str = "annotated.png") -> None:
    flight = Flight.from_config()
    result = flight(open_recording(recording).load(int(index)))
    image = dehaze_frame(result.frame, flight.dehazer).image_rgb  # or result.frame.image_rgb, or either in another size
    for annotator in (MagnifierAnnotator(), LineAnnotator(), NeedleAnnotator()):
        image = annotator.annotate(image, result)
    Image.fromarray(image).save(picture)
    print(picture, result.guidance.status)


if __name__ == "__main__":
    main(*sys.argv[1:])
