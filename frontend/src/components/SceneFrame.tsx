import { Button, NativeSelect } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import { canDrawSolid, paintsInSoftware } from "../drawing/canvas";
import { FramePacer, paceWindow } from "../drawing/pacer";
import { fillText } from "../samples/texts";
import { watchKeys } from "../stop/stop";
import styles from "./SceneFrame.module.css";
import { TEXTS } from "./texts";

/** How far a 3D view has come, and what is said of it until there is a picture. */

/** What backend/scene/proxy.py writes on its document, in the order in which it comes; "dropped" by the browser. */
const TOLD = ["connecting", "drawing", "shown", "lost", "dropped"] as const;

/** Before its page is there, and when what came is not its page. */
type Stage = (typeof TOLD)[number] | "page" | "failed";

/** Somebody who has waited so long is told so [s]. */
export const PATIENCE_S = 20;

const LOADING = {
  page: TEXTS.sceneLoadingPage,
  connecting: TEXTS.sceneLoadingData,
  drawing: TEXTS.sceneDrawing,
} as const;
const LATE = {
  page: TEXTS.sceneLatePage,
  connecting: TEXTS.sceneLateData,
  drawing: TEXTS.sceneLateDrawing,
} as const;

/** The stage that the document in a frame tells; another document than the view's, as the browser's own, tells none. */
function stageIn(frame: HTMLIFrameElement): Stage {
  const told = frame.contentDocument?.documentElement.dataset.stage;
  return TOLD.find((stage) => stage === told) ?? "failed";
}

/** Empty once there is a picture. `software`: the browser paints without a graphics processor. */
function describeStage(stage: Stage, late: boolean, software: boolean): string {
  switch (stage) {
    case "shown":
      return "";
    case "failed":
      return TEXTS.sceneFailed;
    case "lost":
      return TEXTS.sceneLost;
    case "dropped":
      return TEXTS.sceneDropped;
  }
  if (late) return fillText(LATE[stage], { time: PATIENCE_S });
  return stage === "drawing" && software ? TEXTS.sceneDrawingSlowly : LOADING[stage];
}

/** A 3D view of the service in a frame: it says what it waits for, STOP is heard in it, and it leaves the page time to act. */

/** Times the length of a slow 3D frame that is left to the loop and the charts. */
const REST = 4;

interface SceneFrameProps {
  /** With a query. */
  readonly address: string;
  readonly title: string;
}

export function SceneFrame({ address, title }: SceneFrameProps) {
  const [attempt, setAttempt] = useState(0);
  // an address of its own for each attempt: what the browser has kept of the one before may be what is wrong
  const asked = attempt === 0 ? address : `${address}&attempt=${attempt}`;
  // from another camera it is another page, which has to be listened to from its beginning
  return <View key={asked} address={asked} title={title} onAgain={() => setAttempt(attempt + 1)} />;
}

function View({ address, title, onAgain }: SceneFrameProps & { onAgain: () => void }) {
  const frame = useRef<HTMLIFrameElement>(null);
  const [stage, setStage] = useState<Stage>("page");
  const [late, setLate] = useState<Stage | null>(null);
  const [possible] = useState(canDrawSolid);

  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    let unwatch = () => {};
    const onMessage = (event: MessageEvent) => {
      if (event.source === element.contentWindow) setStage(stageIn(element));
    };
    const onLoad = () => {
      unwatch();
      const told = stageIn(element);
      setStage(told);
      if (told === "failed" || element.contentWindow === null) return;
      // keys pressed while the 3D view has the focus go to its own document: STOP has to listen there too
      unwatch = watchKeys(element.contentWindow);
      paceWindow(element.contentWindow, new FramePacer(REST));
    };
    window.addEventListener("message", onMessage);
    element.addEventListener("load", onLoad);
    return () => {
      window.removeEventListener("message", onMessage);
      element.removeEventListener("load", onLoad);
      unwatch();
    };
  }, []);

  useEffect(() => {
    setLate(null);
    const timer = window.setTimeout(() => setLate(stage), PATIENCE_S * 1000);
    return () => window.clearTimeout(timer);
  }, [stage]);

  const words = possible ? describeStage(stage, late === stage, paintsInSoftware()) : TEXTS.sceneImpossible;
  const stuck = stage === "failed" || stage === "dropped" || (stage !== "shown" && late === stage);
  return (
    <div className={styles.frame}>
      <iframe ref={frame} src={address} title={title} className={styles.view} data-stage={stage} />
      <div className={styles.words} data-empty={words === ""}>
        {/* always there, so that a change of its words is heard */}
        <output aria-label={fillText(TEXTS.sceneStatus, { title })}>{words}</output>
        {possible && stuck && (
          <Button size="compact-xs" variant="default" onClick={onAgain}>
            {TEXTS.tryAgain}
          </Button>
        )}
      </div>
    </div>
  );
}

/** Where the 3D view can be looked at from. Pure. In the scene's units: ten to the metre, z up, the joint at the origin. */

interface Camera {
  /** Stored in the preferences. */
  readonly name: string;
  readonly label: string;
  readonly position: readonly [number, number, number];
  readonly lookAt: readonly [number, number, number];
}

const CAMERAS: readonly Camera[] = [
  { name: "Front", label: TEXTS.cameraFront, position: [1.6, -10.2, 1], lookAt: [0, 0, -0.48] },
  { name: "Side", label: TEXTS.cameraSide, position: [9.5, -3.4, 0.4], lookAt: [0, 0, -0.6] },
  { name: "Above", label: TEXTS.cameraAbove, position: [1.2, -6.4, 8], lookAt: [0, 0, -0.4] },
  { name: "Joint", label: TEXTS.cameraJoint, position: [0.6, -4.6, 1.2], lookAt: [0, 0, 0.4] },
  { name: "Springs", label: TEXTS.cameraSprings, position: [0.4, -5, -1.4], lookAt: [0, 0, -1.9] },
];

/** The address of the 3D view, at `path`, seen by the camera of this name. */
export function sceneAddress(path: string, name: string): string {
  const camera = CAMERAS.find((one) => one.name === name) ?? CAMERAS[0];
  if (camera === undefined) return path;
  const { position, lookAt } = camera;
  return `${path}?initialCameraPosition=${position.join(",")}&initialCameraLookAt=${lookAt.join(",")}`;
}

/** From where a 3D view is looked at. */

export function CameraChoice({ camera, onChange }: { camera: string; onChange: (name: string) => void }) {
  return (
    <NativeSelect
      aria-label={TEXTS.camera}
      size="xs"
      value={camera}
      onChange={(event) => onChange(event.currentTarget.value)}
      data={CAMERAS.map(({ name, label }) => ({ value: name, label }))}
      styles={{ input: { height: 24, minHeight: 24 } }}
    />
  );
}
