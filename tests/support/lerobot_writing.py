"""What LeRobot's own dataset class writes and reads, whichever version is installed."""


def open_dataset(lerobot, root):
    return lerobot.LeRobotDataset("nas/test", root=root, video_backend="pyav")


def create(lerobot, dataset, root):
    features = {key: {**feature.to_info(), "shape": (feature.width,)} for key, feature in dataset.features.items()}
    return lerobot.LeRobotDataset.create(
        "nas/test",
        fps=dataset.fps,
        features=features,
        root=root,
        robot_type=dataset.robot_type,
        use_videos=False,
        video_backend="pyav",
    )


def resume(lerobot, root):
    kind = lerobot.LeRobotDataset
    if hasattr(kind, "resume"):
        return kind.resume("nas/test", root=root, video_backend="pyav")
    return kind("nas/test", root=root, video_backend="pyav")


def record(target, dataset, episodes):
    for episode in episodes:
        for row in range(*dataset.episode(episode).indices(dataset.n_frames)):
            frame = {key: column[row] for key, column in dataset.columns.items()}
            target.add_frame({**frame, "task": dataset.tasks[episode]})
        target.save_episode()


def make_durable(dataset):
    """Let LeRobot close its files after each episode."""
    if isinstance(dataset.meta.info, dict):
        dataset.meta.info["data_files_size_in_mb"] = 1e-9
    else:
        dataset.meta.info.data_files_size_in_mb = 1e-9
    dataset.meta._metadata_buffer_size = dataset.meta.metadata_buffer_size = 1
    save = dataset.save_episode

    def save_episode():
        save()
        close = dataset.writer.close_writer if hasattr(dataset.writer, "close_writer") else dataset._close_writer
        close()
        dataset.meta._close_writer()

    dataset.save_episode = save_episode
