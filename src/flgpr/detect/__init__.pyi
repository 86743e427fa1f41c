from flgpr.detect.deflection import DeflectionDetector as DeflectionDetector
from flgpr.detect.deflection import NeymanPearsonDetector as NeymanPearsonDetector
from flgpr.detect.deflection import PolarimetricWhiteningFilter as PolarimetricWhiteningFilter
from flgpr.detect.deflection import deflection_form as deflection_form
from flgpr.detect.deflection import magnitude_form as magnitude_form
from flgpr.detect.deflection import neyman_pearson_form as neyman_pearson_form
from flgpr.detect.fisher import FisherDiscriminant as FisherDiscriminant
from flgpr.detect.fisher import HistogramNormalizer as HistogramNormalizer
from flgpr.detect.fisher import hit_weights as hit_weights
from flgpr.detect.linear_quadratic import ChipDetector as ChipDetector
from flgpr.detect.linear_quadratic import LinearQuadraticForm as LinearQuadraticForm
from flgpr.detect.one_class import OneClassRelevanceVectorMachine as OneClassRelevanceVectorMachine
from flgpr.detect.one_class_mixture import GaussianMixtureNovelty as GaussianMixtureNovelty
from flgpr.detect.rvm import RelevanceVectorClassifier as RelevanceVectorClassifier
from flgpr.detect.rvm import leave_one_out as leave_one_out
from flgpr.detect.search import Fold as Fold
from flgpr.detect.search import SearchStep as SearchStep
from flgpr.detect.search import forward_search as forward_search
from flgpr.detect.search import make_fold as make_fold
from flgpr.detect.search import single_features as single_features
from flgpr_ground.detect.multiple_kernels import (
    MultipleKernelClassifier as MultipleKernelClassifier,
)
from flgpr_ground.detect.principal_components import (
    PrincipalComponentDetector as PrincipalComponentDetector,
)
