"""The rivals among estimators, by the names that recipes use. None of them is loaded here."""

from flgpr.detect.estimator_table import Estimator

_TREES = "flgpr_ground.scorers.trees"
_DENSITIES = "flgpr_ground.scorers.densities"
_PYOD = "PyOD: pip install 'flgpr[benchmark]'"
ESTIMATORS = {
    "mixture": Estimator(
        "flgpr.detect.one_class_mixture:GaussianMixtureNovelty",
        f"{_DENSITIES}:MixtureScorer",
        least=2,
    ),
    "mkl": Estimator(
        "flgpr_ground.detect.multiple_kernels:MultipleKernelClassifier",
        "flgpr_ground.scorers.multiple_kernels:MultipleKernelScorer",
        grouped=True,
    ),
    "random-forest": Estimator("sklearn.ensemble:RandomForestClassifier", f"{_TREES}:ForestScorer"),
    "gradient-boosting": Estimator(
        "sklearn.ensemble:HistGradientBoostingClassifier", f"{_TREES}:BoostedScorer"
    ),
    "isolation-forest": Estimator("sklearn.ensemble:IsolationForest", f"{_TREES}:IsolationScorer"),
    "ecod": Estimator(
        "pyod.models.ecod:ECOD", f"{_DENSITIES}:TailScorer", outward=True, needs=_PYOD
    ),
    "copod": Estimator(
        "pyod.models.copod:COPOD", f"{_DENSITIES}:CopulaScorer", outward=True, needs=_PYOD
    ),
    "knn": Estimator(
        "pyod.models.knn:KNN",
        f"{_DENSITIES}:NeighbourScorer",
        outward=True,
        neighbours=5,
        needs=_PYOD,
    ),
}
