"""The paper's rivals, its own estimator, ablations and checks of data: nothing that flies imports it."""
