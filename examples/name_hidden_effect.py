"""Name a hidden effect: record an arm that has play in its gear, and ask what its model lacks."""

import nas_data as nas

# What the model does not know: ±0.05 rad of play between servo and link.
HIDDEN = "backlash:joint=pendulum,half_width=0.05"


def main() -> None:
    """Record, search, and compare the answer with the truth."""
    # `blind` keeps the effect out of the recording's provenance, so that nothing gives it away.
    ds = nas.record(
        "pendulum",
        effects=[HIDDEN],
        excitation="multisine",
        rate=50,
        episodes=6,
        seconds=2,
        noise=0.0005,
        blind=True,
    )
    print(ds)

    report = nas.identify(ds, model="pendulum", progress=print)
    print(report)
    for effect in report.effects:
        for name, parameter in effect.parameters.items():
            low, high = parameter.interval95
            print(f"{effect}: {name} {parameter.value:.4f} {parameter.unit}, 95 % in [{low:.4f}, {high:.4f}]")
    print(f"hidden was: {HIDDEN}")

    # The picture of an episode that was held out: measured, model before, model after.
    report.plot("pendulum").savefig("hidden_effect.png")
    print("hidden_effect.png shows a held-out episode")


if __name__ == "__main__":
    main()
