/** What can be done with the stretch in sight: measure, figures, spectrum, picture, data. */

import { ActionIcon, Button, Menu, Tooltip } from "@mantine/core";
import type { ReactNode } from "react";
import { TbCameraDown, TbChartHistogram, TbFileTypeCsv, TbRulerMeasure, TbSum } from "react-icons/tb";
import styles from "./Charts.module.css";
import type { PictureKind } from "./save";

interface ChartToolsProps {
  readonly measuring: boolean;
  readonly figures: boolean;
  onMeasure(): void;
  onFigures(): void;
  onSpectrum(): void;
  onPicture(kind: PictureKind): void;
  onData(): void;
}

export function ChartTools(props: ChartToolsProps) {
  const { measuring, figures, onMeasure, onFigures, onSpectrum, onPicture, onData } = props;
  return (
    <span className={styles.tools}>
      <Button
        px={8}
        variant={measuring ? "light" : "default"}
        aria-pressed={measuring}
        leftSection={<TbRulerMeasure size={14} />}
        onClick={onMeasure}
      >
        Measure
      </Button>
      <Tool name="Statistics" hint="Min, max, mean of what is in sight" pressed={figures} onClick={onFigures}>
        <TbSum size={16} />
      </Tool>
      <Tool name="Spectrum" hint="Spectrum of what is in sight, or between the cursors" onClick={onSpectrum}>
        <TbChartHistogram size={16} />
      </Tool>
      <Menu position="top" withinPortal>
        <Menu.Target>
          <ActionIcon
            variant="default"
            size={30}
            aria-label="Save picture"
            title="Picture of what is in sight"
          >
            <TbCameraDown size={16} />
          </ActionIcon>
        </Menu.Target>
        <Menu.Dropdown>
          <Menu.Item onClick={() => onPicture("svg")}>SVG, vectors</Menu.Item>
          <Menu.Item onClick={() => onPicture("pdf")}>PDF, 180 mm, vectors with fonts</Menu.Item>
          <Menu.Item onClick={() => onPicture("png")}>PNG, 180 mm at 300 dpi</Menu.Item>
        </Menu.Dropdown>
      </Menu>
      <Tool name="Save data" hint="Data of what is in sight (CSV, SI)" onClick={onData}>
        <TbFileTypeCsv size={16} />
      </Tool>
    </span>
  );
}

interface ToolProps {
  readonly name: string;
  readonly hint: string;
  readonly pressed?: boolean;
  readonly children: ReactNode;
  onClick(): void;
}

function Tool({ name, hint, pressed, children, onClick }: ToolProps) {
  return (
    <Tooltip label={hint} position="top">
      <ActionIcon
        variant={pressed === true ? "light" : "default"}
        size={30}
        aria-label={name}
        {...(pressed === undefined ? {} : { "aria-pressed": pressed })}
        onClick={onClick}
      >
        {children}
      </ActionIcon>
    </Tooltip>
  );
}
