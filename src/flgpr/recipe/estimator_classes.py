"""The estimators that a recipe may name as its detector. None of them is loaded here."""

ALLOWED = {
    "rvm": "flgpr.detect.rvm.RelevanceVectorClassifier",
    "one-class-rvm": "flgpr.detect.one_class.OneClassRelevanceVectorMachine",
    "mixture": "flgpr.detect.one_class_mixture.GaussianMixtureNovelty",
    "svm": "sklearn.svm.SVC",
    "one-class-svm": "sklearn.svm.OneClassSVM",
    "mkl": "flgpr.detect.multiple_kernels.MultipleKernelClassifier",
    "logistic": "sklearn.linear_model.LogisticRegression",
    "lda": "sklearn.discriminant_analysis.LinearDiscriminantAnalysis",
    "random-forest": "sklearn.ensemble.RandomForestClassifier",
    "gradient-boosting": "sklearn.ensemble.HistGradientBoostingClassifier",
    "isolation-forest": "sklearn.ensemble.IsolationForest",
    "ecod": "pyod.models.ecod.ECOD",
    "copod": "pyod.models.copod.COPOD",
    "knn": "pyod.models.knn.KNN",
}
"""Classes that are trained, by the name that recipes use.

Only training reads this table: a model holds arrays and settings, and no class.
"""

GROUPED = ("mkl",)
"""Estimators that read features in groups: each entry of a detector's ``features`` is one."""
