import numpy as np
import pytest
import torch

from deckline.detect.anchors import ROW_OUTPUTS
from deckline.runtime import shipped_weights
from deckline.runtime.session import load_session
from deckline.train.checkpoint import save_checkpoint
from deckline.train.detect_finish import export_detect, torch_infer
from deckline.train.detect_start import settle_norms, start_detector
from deckline.train.detectors import DETECTORS_TO_TRAIN
from deckline.train.detectors.hybrid import Hybrid
from deckline.train.ufld import Ufld, UfldConfig

SMALL = UfldConfig(channels=16, pretrained=False)


def test_a_detector_goes_on_from_the_shipped_file():
    path = shipped_weights("detect")
    model = Ufld(UfldConfig(pretrained=False)).eval()
    before = model.segmentation.weight.detach().clone()
    start_detector(model, path)
    view = np.random.default_rng(1).standard_normal((3, 288, 512), dtype=np.float32)
    session = load_session(path, threads=1)
    theirs = dict(zip(session.output_names, session(image=view[None]), strict=True))
    for name, ours in zip(ROW_OUTPUTS, torch_infer(model)(view), strict=False):
        np.testing.assert_allclose(ours, theirs[name][0], atol=5e-3)
    torch.testing.assert_close(model.segmentation.weight, before)
    assert all(torch.all(n.running_var + n.eps == 1.0) for n in model.modules() if isinstance(n, torch.nn.BatchNorm2d))


def test_the_hybrid_takes_what_both_networks_have():
    path = shipped_weights("detect")
    earlier, model = Ufld(UfldConfig(pretrained=False)).eval(), Hybrid(pretrained=False).eval()
    start_detector(earlier, path)
    start_detector(model, path)
    image = torch.from_numpy(np.random.default_rng(1).standard_normal((1, 3, 288, 512), dtype=np.float32))
    with torch.no_grad():
        one, other = earlier(image), model(image)
    torch.testing.assert_close(one.region, other.region, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(
        one.rows[..., :-1].log_softmax(-1), other.rows[:, :2, :, :-1].log_softmax(-1), atol=1e-3, rtol=1e-3
    )


def test_the_hybrid_goes_on_from_its_own_file():
    path = shipped_weights("hybrid")
    model = Hybrid(pretrained=False).eval()
    start_detector(model, path)
    view = np.random.default_rng(1).standard_normal((3, 288, 512), dtype=np.float32)
    session = load_session(path, threads=1)
    theirs = dict(zip(session.output_names, session(image=view[None]), strict=True))
    for name, ours in zip(
        ("row_logits", "region_logits", "region_box", "column_logits"), torch_infer(model)(view), strict=True
    ):
        np.testing.assert_allclose(ours, theirs[name][0], atol=2e-2)


def test_settled_norms_change_nothing_but_how_training_begins():
    model = Ufld(SMALL)
    images = torch.from_numpy(np.random.default_rng(2).standard_normal((2, 3, 288, 512), dtype=np.float32))
    with torch.no_grad():
        before = model.eval()(images)
        settle_norms(model, images)
        after, training = model(images), model.train()(images)
    torch.testing.assert_close(after.rows, before.rows, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(training.rows, before.rows, atol=5e-2, rtol=5e-2)


def test_a_training_folder_is_a_start_too(tmp_path):
    first, second = Ufld(SMALL), Ufld(SMALL)
    optimizer = torch.optim.SGD(first.parameters(), 0.1)
    save_checkpoint(tmp_path, first, optimizer, dict(first.state_dict()), {"recipe": {}, "step": 0, "seconds": 0.0})
    start_detector(second, tmp_path)
    for name, value in first.state_dict().items():
        torch.testing.assert_close(second.state_dict()[name], value)


def test_files_of_other_networks_are_refused(tmp_path):
    path = export_detect(Ufld(SMALL).eval(), tmp_path / "small.onnx", {}, 0)
    with pytest.raises(ValueError, match=r"detect_ufld\.onnx holds another network: .* does not fit"):
        start_detector(Ufld(SMALL), shipped_weights("detect"))
    with pytest.raises(ValueError, match=r"dehaze_coarse_t\.onnx holds another network"):
        start_detector(Ufld(SMALL), shipped_weights("dehaze"))
    with pytest.raises(ValueError, match=r"small\.onnx: only networks deckline and hybrid start from an \.onnx file"):
        start_detector(DETECTORS_TO_TRAIN["enet-sad"](), path)
    with pytest.raises(ValueError, match="holds no checkpoint to start from"):
        start_detector(Ufld(SMALL), tmp_path)
    (tmp_path / "text.onnx").write_text("no network")
    with pytest.raises(ValueError, match=r"text\.onnx is not a usable ONNX model"):
        start_detector(Ufld(SMALL), tmp_path / "text.onnx")
