"""GridDehazeNet: dense blocks, and how a column joins its rows."""

import pytest
import torch

from deckline.train.rivals.grid_dehaze_net import (
    GridColumn,
    GridDehazeNet,
    GridDehazeNetConfig,
    ResidualDenseBlock,
    grid_down,
    grid_up,
)

SMALL = GridDehazeNetConfig(channels=4, dense_layers=2, growth=3)


def test_dense_block_is_its_input_when_it_fuses_nothing() -> None:
    block, x = ResidualDenseBlock(4, 3, 5), torch.rand(1, 4, 6, 7)
    assert [layer.in_channels for layer in block.layers] == [4, 9, 14]
    assert block.fuse.in_channels == 19
    block.fuse.weight.data.zero_()
    block.fuse.bias.data.zero_()
    with torch.no_grad():
        torch.testing.assert_close(block(x), x)


def test_sizes_halve_and_double() -> None:
    x = torch.rand(1, 8, 12, 20)
    with torch.no_grad():
        assert grid_down(8)(x).shape == (1, 16, 6, 10)
        assert grid_up(8)(x).shape == (1, 4, 24, 40)


@pytest.mark.parametrize("downwards", [True, False])
def test_column_joins_rows_with_its_weights(downwards: bool) -> None:
    torch.manual_seed(0)
    column = GridColumn(SMALL, downwards)
    nodes = [torch.rand(1, 4 * 2**row, 16 // 2**row, 24 // 2**row) for row in range(3)]
    for joint in column.joints:
        joint.data = torch.rand_like(joint)
    with torch.no_grad():
        after = column(nodes)
        order = (0, 1, 2) if downwards else (2, 1, 0)
        torch.testing.assert_close(after[order[0]], column.dense[0](nodes[order[0]]))
        for k in (1, 2):
            along, across = column.dense[k](nodes[order[k]]), column.links[k - 1](after[order[k - 1]])
            joint = column.joints[k - 1]
            torch.testing.assert_close(after[order[k]], joint[0] * along + joint[1] * across)


def test_first_half_of_the_columns_goes_down() -> None:
    assert [column.downwards for column in GridDehazeNet(SMALL).columns] == [True, True, False, False, False]
