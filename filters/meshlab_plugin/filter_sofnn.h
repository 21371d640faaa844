// SPDX-FileCopyrightText: o3d_sofnn contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//
// This program is free software: you can redistribute it and/or modify it under the terms of the GNU
// General Public License as published by the Free Software Foundation, either version 3 of the License,
// or (at your option) any later version. It comes WITHOUT ANY WARRANTY; see <https://www.gnu.org/licenses/>.

// SOFNN normals and surfaces as MeshLab filters. The algorithm is not in here: in the MeshLab program
// a filter runs the program o3d-sofnn, in PyMeshLab it calls the engine that Python has set.

#pragma once

#include <common/plugins/interfaces/filter_plugin.h>

// One call of a filter as Python sees it through ctypes; meshlab_sofnn/native.py mirrors it.
struct SofnnJob
{
	const char *command, *options;                // options: those of the program o3d-sofnn, one a line
	int64_t scalarSize, stride, count;            // bytes of a number and of a vertex; vertices
	void *points, *normals, *colors, *confidence; // of the first vertex
	void (*progress)(SofnnJob*, int percent, const char* text);
	// Makes the result's mesh; from then on count and the pointers are those of its vertices.
	void (*makeMesh)(SofnnJob*, int64_t vertices, int64_t triangles, const int32_t* indices);
	void (*finish)(SofnnJob*, const char* error, const char* summary); // either one; summary: JSON
};
using SofnnEngine = void (*)(SofnnJob*);

struct Task
{
	QString command;
	QStringList options;
	MeshModel& cloud;
	MeshDocument& scratch; // the result becomes its current mesh
	vcg::CallBackPos* report;
	std::map<std::string, QVariant> summary;
};
void runPython(SofnnEngine engine, Task& task); // both throw MLException
void runProgram(Task& task);

class FilterSofnn : public QObject, public FilterPlugin
{
	Q_OBJECT
	MESHLAB_PLUGIN_IID_EXPORTER(FILTER_PLUGIN_IID)
	Q_INTERFACES(FilterPlugin)

public:
	enum { RECONSTRUCT, NORMALS };
	FilterSofnn();
	QString pluginName() const override { return "FilterSofnn"; }
	QString vendor() const override { return "o3d_sofnn contributors"; }
	QString filterName(ActionIDType filter) const override;
	QString pythonFilterName(ActionIDType filter) const override;
	QString filterInfo(ActionIDType filter) const override;
	FilterClass getClass(const QAction* a) const override { return ID(a) == RECONSTRUCT ? Remeshing : Normal; }
	FilterArity filterArity(const QAction*) const override { return SINGLE_MESH; }
	int postCondition(const QAction* a) const override
	{
		return ID(a) == RECONSTRUCT ? MeshModel::MM_VERTNUMBER : MeshModel::MM_VERTNORMAL;
	}
	RichParameterList initParameterList(const QAction* action, const MeshModel& layer) override;
	std::map<std::string, QVariant> applyFilter(
		const QAction* action, const RichParameterList& values, MeshDocument& document,
		unsigned int& postConditionMask, vcg::CallBackPos* report) override;
};
