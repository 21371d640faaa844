// SPDX-FileCopyrightText: o3d_sofnn contributors
// SPDX-License-Identifier: GPL-3.0-or-later

#include "filter_sofnn.h"

#include <QJsonDocument>
#include <QJsonObject>
#include <QProcess>
#include <QStandardPaths>
#include <QTemporaryDir>
#include <common/plugins/plugin_manager.h>
#include <common/utilities/load_save.h>
#include <cstdio>

struct PythonJob : SofnnJob
{
	Task* task;
	QString error;

	void pointTo(CMeshO& mesh)
	{
		CMeshO::VertexType& first = mesh.vert.front();
		scalarSize = sizeof(Scalarm), stride = sizeof(first), count = mesh.vn;
		points = &first.P(), normals = &first.N(), colors = &first.C(), confidence = &first.Q();
	}
};

void runPython(SofnnEngine engine, Task& task)
{
	const QByteArray command = task.command.toUtf8(), options = task.options.join('\n').toUtf8();
	PythonJob job {};
	job.task = &task;
	job.command = command, job.options = options;
	job.pointTo(task.cloud.cm);
	job.progress = [](SofnnJob* self, int percent, const char* text) {
		static_cast<PythonJob*>(self)->task->report(percent, text);
	};
	job.makeMesh = [](SofnnJob* self, int64_t vertices, int64_t triangles, const int32_t* indices) {
		auto& job = *static_cast<PythonJob*>(self);
		CMeshO& mesh = job.task->scratch.addNewMesh("", "result", true)->cm;
		vcg::tri::Allocator<CMeshO>::AddVertices(mesh, vertices);
		vcg::tri::Allocator<CMeshO>::AddFaces(mesh, triangles);
		for (int64_t i = 0; i < 3 * triangles; ++i)
			mesh.face[i / 3].V(i % 3) = &mesh.vert[indices[i]];
		job.pointTo(mesh);
	};
	job.finish = [](SofnnJob* self, const char* error, const char* summary) {
		static_cast<PythonJob*>(self)->error = error;
		const QVariantMap numbers = QJsonDocument::fromJson(summary).object().toVariantMap();
		for (auto it = numbers.begin(); it != numbers.end(); ++it) // PyMeshLab drops 64-bit integers
			static_cast<PythonJob*>(self)->task->summary[it.key().toStdString()] =
				it->type() == QVariant::LongLong ? QVariant(it->toInt()) : *it;
	};
	engine(&job);
	if (!job.error.isEmpty())
		throw MLException(job.error);
}

void runProgram(Task& task)
{
	const QString name = qEnvironmentVariable("O3D_SOFNN_PROGRAM", "o3d-sofnn");
	const QString program = QStandardPaths::findExecutable(name);
	if (program.isEmpty())
		throw MLException(
			"The program '" + name + "' was not found. Install it with: pip install \"o3d_sofnn[open3d]\". "
			"If it is not on the PATH, let the environment variable O3D_SOFNN_PROGRAM name it.");
	const QTemporaryDir folder;
	const QString in = folder.filePath("in.ply"), out = folder.filePath("out.ply");
	IOPlugin* ply = meshlab::pluginManagerInstance().outputMeshPlugin("PLY");
	if (!folder.isValid() || !ply)
		throw MLException("Cannot write a PLY file into a temporary folder. " + folder.errorString());
	const int mask = vcg::tri::io::Mask::IOM_VERTNORMAL | vcg::tri::io::Mask::IOM_VERTCOLOR;
	ply->save("PLY", in, task.cloud, mask, ply->initSaveParameter("PLY", task.cloud));

	QProcess process;
	QProcessEnvironment environment = QProcessEnvironment::systemEnvironment();
	// MeshLab's bundles set these for themselves; another program's Python and Qt break on them.
	for (const char* key : {"LD_LIBRARY_PATH", "QT_PLUGIN_PATH", "PYTHONHOME", "PYTHONPATH"})
		environment.remove(key);
	process.setProcessEnvironment(environment);
	process.setStandardInputFile(QProcess::nullDevice());
	process.start(program, QStringList {task.command, in, out, "--progress=plain"} + task.options);
	int percent = 0;
	char stage[100] = "starting o3d-sofnn";
	while (process.state() != QProcess::NotRunning) {
		process.waitForReadyRead(100);
		while (process.canReadLine())
			std::sscanf(process.readLine().constData(), "PROGRESS %d %99[^\r\n]", &percent, stage);
		task.report(percent, stage); // without news too: it keeps MeshLab's window alive
	}
	if (process.exitStatus() != QProcess::NormalExit || process.exitCode() != 0) {
		const QString message = QString::fromLocal8Bit(process.readAllStandardError()).trimmed();
		throw MLException(message.isEmpty() ? program + " failed: " + process.errorString() : message);
	}
	meshlab::loadMeshWithStandardParameters(out, task.scratch);
}
