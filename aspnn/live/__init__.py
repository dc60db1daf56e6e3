"""On the bridge: live sentences in, predictions out, on a page a navigator can use. Depends on everything below but workflow and cli."""
