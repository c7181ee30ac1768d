"""Studies: many runs as one document, on threads or a cluster, into a dataset that no fault harms.

`document` reads a study, `designs` make its points, `blocks` compute them, `places` say where, `store` keeps
files whole, `running` resumes; `dataset` reads what is there, `findings` and `page`
show it, `tuning` searches.
"""

from __future__ import annotations

from vffnull.studies.dataset import Dataset
from vffnull.studies.effects import Indices
from vffnull.studies.estimate import Estimate
from vffnull.studies.findings import Findings
from vffnull.studies.study import Study, studies
from vffnull.studies.tuning import Trial, Tuned

__all__ = ["Dataset", "Estimate", "Findings", "Indices", "Study", "Trial", "Tuned", "studies"]
