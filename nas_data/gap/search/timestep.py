"""Choice between the model's own physics steps and finer ones for a recording."""

from nas_data.gap.nominal import find_fine_timestep
from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.fit import Fit, fit
from nas_data.gap.search.objective import FitTask


def choose_timestep(task: FitTask, found: Fit) -> tuple[FitTask, Fit]:
    """Return the task with the physics steps of the lower loss, and the fit to it.

    A real arm has no timestep; a simulated one has. A hypothesis fitted to one timestep is biased towards it, so both
    are fitted before they are compared.
    """
    if find_fine_timestep(task.nominal) == float(task.nominal.spec.option.timestep):
        return task, found
    parameters, known = found.parameters, dict(enumerate(found.jacobian))
    other = task.switch_timestep(not task.fine, found.effects, found.factors)
    here, there = (fit(each, parameters, found.theta, known, steps=3, jacobian_refreshes=0) for each in (task, other))
    if here is None or there is None:
        return task, found
    ahead = here.loss.over(there.loss)
    return (other, there) if ahead > (PRICE if task.fine else -PRICE) else (task, here)
