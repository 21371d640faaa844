// SPDX-FileCopyrightText: o3d_sofnn contributors
// SPDX-License-Identifier: GPL-3.0-or-later

#include "filter_sofnn.h"

#include <vcg/complex/append.h>

#if __has_include(<common/parameters/rich_parameter/rich_percentage.h>)
using RichLength = RichPercentage;
#else // up to MeshLab 2022.02
using RichLength = RichAbsPerc;
#endif

static SofnnEngine engine = nullptr;
extern "C" Q_DECL_EXPORT int o3d_sofnn_interface_version() { return 1; }
extern "C" Q_DECL_EXPORT void o3d_sofnn_set_engine(SofnnEngine function) { engine = function; }

FilterSofnn::FilterSofnn()
{
	typeList = {RECONSTRUCT, NORMALS};
	for (ActionIDType filter : types())
		actionList.push_back(new QAction(filterName(filter), this));
}

QString FilterSofnn::filterName(ActionIDType filter) const
{
	return filter == RECONSTRUCT ? "Surface Reconstruction: SOFNN" : "Compute normals for point sets: SOFNN";
}

QString FilterSofnn::pythonFilterName(ActionIDType filter) const
{
	return filter == RECONSTRUCT ? "generate_surface_reconstruction_sofnn" : "compute_normal_for_point_clouds_sofnn";
}

QString FilterSofnn::filterInfo(ActionIDType filter) const
{
	const QString what = filter == RECONSTRUCT ? "Watertight mesh from" : "Oriented normals for";
	return what + " a raw point cloud. A few fuzzy rules, each a local quadric, carry the orientation. <b>A Novel "
		"Self-Organized Fuzzy Neural Network Surface Reconstruction Algorithm for Point Clouds Without Normal</b>";
}

RichParameterList FilterSofnn::initParameterList(const QAction* action, const MeshModel& layer)
{
	RichParameterList list;
	const QStringList sides {"automatic", "viewpoint", "direction"};
	Box3m box;
	box.Add(layer.cm.Tr, layer.cm.bbox);
	if (ID(action) == RECONSTRUCT) {
		list.addParam(RichInt("depth", 0, "Depth", "The longest side has 2^depth cells; 0 is automatic."));
		list.addParam(RichLength("voxel_size", 0, 0, box.Diag(), "Voxel size", "Side of a cell; 0 is automatic."));
		list.addParam(RichBool("use_normals", false, "Use normals", "Take the sides from the layer's vertex normals."));
		list.addParam(RichEnum("closed", 0, {"auto", "yes", "no"}, "Closed", "auto: where the points say it is a solid."));
		list.addParam(RichFloat("trim", 0, "Trim", "Cut triangles with a confidence (0 to 1) below this; 0: keep all."));
		list.addParam(RichInt("target_triangles", 0, "Triangles", "Decimate to so many triangles; 0 keeps all."));
		list.addParam(RichLength("precision", 0, 0, box.Diag(), "Precision", "Of local surfaces; 0 is automatic."));
	}
	list.addParam(RichEnum("orientation", 0, sides, "Orientation", "Outwards, to the viewpoint, or along the direction."));
	list.addParam(RichPosition("viewpos", Point3m(0, 0, 0), "Viewpoint", "Where the cloud was seen from."));
	list.addParam(RichDirection("direction", Point3m(0, 0, 1), "Direction", "Which way the normals should point."));
	list.addParam(RichInt("max_nn", 0, "Neighbours", "Most points in a local fit; 0 is automatic."));
	list.addParam(RichLength("radius", 0, 0, box.Diag(), "Radius", "Largest radius of a local fit; 0 is automatic."));
	list.addParam(RichInt("n_threads", -1, "Threads", "-1 is one per core; the result does not depend on it."));
	return list;
}

// What the user chose, as options of the program o3d-sofnn; what is automatic is left out.
static QStringList options(bool reconstruct, const RichParameterList& values)
{
	QStringList list {QString("--threads=%1").arg(values.getInt("n_threads"))};
	const auto text = [](double value) { return QString::number(value, 'g', 17); };
	const auto number = [&](const QString& name, double value) { if (value != 0) list << name + '=' + text(value); };
	const auto point = [&](const QString& name, Point3m p) { list << name << text(p[0]) << text(p[1]) << text(p[2]); };
	number("--max-nn", values.getInt("max_nn")), number("--radius", values.getAbsPerc("radius"));
	if (reconstruct) {
		number("--depth", values.getInt("depth"));
		number("--voxel-size", values.getAbsPerc("voxel_size"));
		list << QStringList {"--closed=auto", "--closed=yes", "--closed=no"}[values.getEnum("closed")];
		list << (values.getBool("use_normals") ? QStringList("--use-normals") : QStringList());
		number("--trim", values.getFloat("trim"));
		number("--precision", values.getAbsPerc("precision")), number("--target-triangles", values.getInt("target_triangles"));
	}
	if (const int side = values.getEnum("orientation"))
		side == 1 ? point("--viewpoint", values.getPoint3m("viewpos")) : point("--towards", values.getPoint3m("direction"));
	return list;
}

// A normal times the transposed linear part of a matrix, as a unit vector.
static Point3m turned(const Matrix44m& m, const Point3m& n)
{
	if (m == Matrix44m::Identity())
		return n; // to the last bit
	Point3m sum(0, 0, 0);
	for (int k = 0; k < 3; ++k)
		sum += Point3m(m[k][0], m[k][1], m[k][2]) * n[k];
	return sum.Normalize();
}

std::map<std::string, QVariant> FilterSofnn::applyFilter(
	const QAction* action, const RichParameterList& values, MeshDocument& document, unsigned int&,
	vcg::CallBackPos* report)
try {
	const bool reconstruct = ID(action) == RECONSTRUCT;
	MeshModel& layer = *document.mm();
	if (layer.cm.vn == 0 || layer.cm.fn > 0)
		throw MLException(QString("Layer '%1': expected a point cloud, got %2 vertices and %3 faces")
			.arg(layer.label()).arg(layer.cm.vn).arg(layer.cm.fn));
	MeshDocument scratch;
	MeshModel& cloud = *scratch.addNewMesh("", "cloud", true);
	vcg::tri::Append<CMeshO, CMeshO>::MeshCopyConst(cloud.cm, layer.cm);
	const Matrix44m matrix = layer.cm.Tr, inverse = vcg::Inverse(matrix);
	for (CMeshO::VertexType& vertex : cloud.cm.vert) {
		vertex.P() = matrix * vertex.P();
		vertex.N() = turned(inverse, vertex.N());
	}
	Task task {
		reconstruct ? "reconstruct" : "normals", options(reconstruct, values), cloud, scratch,
		report ? report : vcg::DummyCallBackPos, {}};
	engine ? runPython(engine, task) : runProgram(task);
	CMeshO& result = scratch.mm()->cm;
	if (reconstruct) {
		MeshModel& made = *document.addNewMesh("", "SOFNN mesh", true);
		vcg::tri::Append<CMeshO, CMeshO>::MeshCopyConst(made.cm, result);
		made.updateDataMask(&layer); // colours, where it has them
		made.updateDataMask(MeshModel::MM_VERTQUALITY);
		vcg::tri::UpdateNormal<CMeshO>::PerFaceNormalized(made.cm);
		vcg::tri::UpdateBounding<CMeshO>::Box(made.cm);
	} else if (result.vn != layer.cm.vn) {
		throw MLException(QString("Of %1 vertices only %2 are finite.").arg(layer.cm.vn).arg(result.vn));
	} else {
		auto from = result.vert.begin();
		for (CMeshO::VertexType& vertex : layer.cm.vert)
			if (!vertex.IsD())
				vertex.N() = turned(matrix, (from++)->N());
		layer.updateDataMask(MeshModel::MM_VERTNORMAL);
	}
	return task.summary;
} catch (const std::exception& error) {
	throw MLException(error.what()); // the only type that MeshLab's window survives
}
