/** Replays a recording: shows the pose of the actuator at the cursor of the charts. */

import { ActionIcon, Button, NativeSelect, Slider } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useCallback, useEffect, useMemo, useState } from "react";
import { TbPlayerPauseFilled, TbPlayerPlayFilled } from "react-icons/tb";
import { type PlotSource, RecordedSource } from "../../charts/sources";
import { type Playhead, usePlayhead } from "../../charts/viewport";
import { CameraChoice, SceneFrame, sceneAddress } from "../../components/SceneFrame";
import { clockTime } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { useSceneView } from "../../service/api/preferences";
import { recordingQuery, showRunMoment } from "../../service/api/recordings";
import { ActuatorDrawing } from "../operate/ActuatorDrawing";
import styles from "./Replay.module.css";
import { TEXTS } from "./texts";

/** Loads single samples around the playhead, because one bucket of the curves can cover seconds. */

const SIGNALS = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B"];
const BLOCK_S = 5;
/** More points than a block has samples, so that the service returns every sample. */
const POINTS = 6000;

/** Returns a function that reads a signal at a time: from the samples around `at_s`, or until these
 * have loaded, from the curves. */
function useMoments(
  run: number,
  at_s: number,
  duration_s: number,
  curves: PlotSource,
): (name: string, time_s: number) => number {
  const last = Math.max(0, Math.ceil(duration_s / BLOCK_S) - 1);
  const block = Math.min(Math.floor(at_s / BLOCK_S), last);
  const { data } = useQuery(recordingQuery(run, blockAt(block), POINTS, SIGNALS));
  // load the next block ahead, so that playback does not wait at the end of a block
  useQuery(recordingQuery(run, blockAt(Math.min(block + 1, last)), POINTS, SIGNALS));
  const source = useMemo(() => {
    if (data === undefined) return curves;
    const samples = new RecordedSource(duration_s);
    samples.setOverview(data);
    return samples;
  }, [data, curves, duration_s]);
  return useCallback((name, time_s) => source.at(name, time_s), [source]);
}

function blockAt(block: number): { from_s: number; to_s: number } {
  return { from_s: block * BLOCK_S, to_s: (block + 1) * BLOCK_S };
}

const SPEEDS = [0.1, 0.25, 1, 4, 10];
const STEP_S = 0.001;
/** Shortest time between two requests of the 3D view. */
const MOMENT_MS = 60;

interface ReplayProps {
  readonly playhead: Playhead;
  readonly run: number;
  readonly source: PlotSource;
  readonly duration_s: number;
}

export function Replay({ playhead, run, source, duration_s }: ReplayProps) {
  const { at_s } = usePlayhead(playhead);
  const moment = useMoments(run, at_s, duration_s, source);
  const show = useCallback((time_s: number) => showRunMoment(run, time_s), [run]);
  return (
    <PlayedBack
      playhead={playhead}
      of={fillText(TEXTS.replayOfRun, { run })}
      read={moment}
      show={show}
      begin_s={0}
      end_s={duration_s}
    />
  );
}

interface PlayedBackProps {
  readonly playhead: Playhead;
  /** Name of the recording. */
  readonly of: string;
  readonly read: (name: string, time_s: number) => number;
  /** Requests a time from the 3D view; must be the same function for the same recording. */
  readonly show: (time_s: number) => Promise<unknown>;
  readonly begin_s: number;
  readonly end_s: number;
}

export function PlayedBack({ playhead, of, read: readAt, show, begin_s, end_s }: PlayedBackProps) {
  const { at_s, playing } = usePlayhead(playhead);
  const [speed, setSpeed] = useState(1);
  const { solid, camera, known, toggle: toggleView, look } = useSceneView(false);
  useMomentIn3D(solid, show, playhead);
  const read = useCallback((name: string) => readAt(name, playhead.at_s), [readAt, playhead]);

  useEffect(() => {
    if (!playing) return;
    let before_ms = performance.now();
    let request = requestAnimationFrame(function next(now_ms) {
      const moved_s = playhead.at_s + (speed * Math.max(0, now_ms - before_ms)) / 1000;
      before_ms = now_ms;
      playhead.set(Math.min(moved_s, end_s));
      if (moved_s >= end_s) playhead.play(false);
      else request = requestAnimationFrame(next);
    });
    return () => cancelAnimationFrame(request);
  }, [playhead, playing, speed, end_s]);

  function toggle(): void {
    if (!playing && at_s >= end_s) playhead.set(begin_s);
    playhead.play(!playing);
  }

  return (
    <section className={styles.replay} aria-label={TEXTS.replay}>
      <p className={styles.origin}>
        <strong className={styles.badge}>{TEXTS.replayBadge}</strong>
        {fillText(TEXTS.notLive, { recording: of })}
      </p>
      {solid ? (
        <SceneFrame address={sceneAddress("./replay/", camera)} title={TEXTS.replayIn3D} />
      ) : (
        <ActuatorDrawing read={read} />
      )}
      <div className={styles.controls}>
        <Button size="compact-xs" variant="default" disabled={!known} onClick={toggleView}>
          {solid ? TEXTS.showFlat : TEXTS.showIn3D}
        </Button>
        {solid && <CameraChoice camera={camera} onChange={look} />}
      </div>
      <div className={styles.controls}>
        <ActionIcon
          variant="default"
          size={30}
          aria-label={playing ? TEXTS.pause : TEXTS.play}
          onClick={toggle}
        >
          {playing ? <TbPlayerPauseFilled size={14} /> : <TbPlayerPlayFilled size={14} />}
        </ActionIcon>
        <output aria-label={TEXTS.replayTime}>{clockTime(at_s, 0.01)}</output>
        <NativeSelect
          aria-label={TEXTS.replaySpeed}
          value={String(speed)}
          onChange={(event) => setSpeed(Number(event.currentTarget.value))}
          data={SPEEDS.map((value) => ({ value: String(value), label: `× ${value}` }))}
        />
      </div>
      <Slider
        size="sm"
        thumbLabel={TEXTS.replayPosition}
        label={null}
        min={begin_s}
        max={end_s}
        step={STEP_S}
        value={at_s}
        onChange={(value) => playhead.set(value)}
      />
    </section>
  );
}

/** Keeps the 3D view at the playhead; sends the next request after the response to the previous one. */
function useMomentIn3D(
  wanted: boolean,
  show: (time_s: number) => Promise<unknown>,
  playhead: Playhead,
): void {
  useEffect(() => {
    if (!wanted) return;
    let shown = Number.NaN;
    let ended = false;
    const follow = async () => {
      while (!ended) {
        const at_s = playhead.at_s;
        if (at_s !== shown) {
          // the header reports an unreachable service; the next request tries again
          await show(at_s).catch(() => undefined);
          shown = at_s;
        }
        await new Promise((resume) => window.setTimeout(resume, MOMENT_MS));
      }
    };
    void follow();
    return () => {
      ended = true;
    };
  }, [wanted, show, playhead]);
}
