/** The operator's page: charts, 3D view, controls. */

import { OperatorsOnly } from "../../components/OperatorsOnly";
import { CardJumps } from "./CardJumps";
import { LiveCharts } from "./LiveCharts";
import { MapCard } from "./MapCard";
import { ModeCard } from "./ModeCard";
import styles from "./Operate.module.css";
import { PushCard } from "./PushCard";
import { ReferencesCard } from "./ReferencesCard";
import { SceneCard } from "./SceneCard";
import { TouchCard } from "./TouchCard";
import { TuningCard } from "./TuningCard";
import { ViewOnly } from "./ViewOnly";
import { WallCard } from "./WallCard";

export function OperatePage() {
  return (
    <div className={styles.page}>
      <h1 className="visually-hidden">Operate</h1>
      <div className={styles.charts}>
        <LiveCharts />
      </div>
      <div className={styles.views}>
        <SceneCard />
        <MapCard />
      </div>
      <div className={styles.controls}>
        <OperatorsOnly otherwise={<ViewOnly />}>
          <CardJumps />
          <ModeCard />
          <ReferencesCard />
          <TuningCard />
          <TouchCard />
          <PushCard />
          <WallCard />
        </OperatorsOnly>
      </div>
    </div>
  );
}
