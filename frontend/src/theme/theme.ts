/** Mantine theme: greys, one accent colour, and default properties of components. */

import { createTheme, type MantineColorsTuple } from "@mantine/core";

const iris: MantineColorsTuple = [
  "#f0effc",
  "#dddbf7",
  "#c0bcf0",
  "#a19be8",
  "#8a83e0",
  "#7770d6",
  "#655ec9",
  "#4f4bb8",
  "#403c9c",
  "#322f7d",
];

const dark: MantineColorsTuple = [
  "#dde1e6",
  "#b9bfc7",
  "#98a0aa",
  "#69717b",
  "#3b4149",
  "#2d3238",
  "#1d2126",
  "#14171a",
  "#0f1113",
  "#0a0b0d",
];

const gray: MantineColorsTuple = [
  "#f7f8f9",
  "#f1f3f5",
  "#e6e9ed",
  "#d9dde2",
  "#c3c9d0",
  "#a4abb5",
  "#7b838e",
  "#59616b",
  "#363c44",
  "#1b1f24",
];

export const theme = createTheme({
  primaryColor: "iris",
  primaryShade: { light: 7, dark: 6 },
  colors: { iris, dark, gray },
  black: "#1b1f24",
  fontFamily: 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif',
  fontFamilyMonospace: 'ui-monospace, "SF Mono", Menlo, Consolas, "Liberation Mono", monospace',
  defaultRadius: 4,
  spacing: { xs: "4px", sm: "8px", md: "12px", lg: "16px", xl: "24px" },
  fontSizes: { xs: "12px", sm: "13px", md: "14px", lg: "16px", xl: "20px" },
  headings: { fontWeight: "600" },
  focusRing: "auto",
  respectReducedMotion: true,
  components: {
    Modal: { defaultProps: { yOffset: 72, closeButtonProps: { "aria-label": "Close" } } },
    Drawer: { defaultProps: { closeButtonProps: { "aria-label": "Close" } } },
    Button: { defaultProps: { size: "xs", fw: 500 } },
    InputWrapper: { styles: { label: { fontWeight: 500 } } },
    TextInput: { defaultProps: { size: "xs" } },
    SegmentedControl: { styles: { label: { paddingInline: 10, paddingBlock: 4 } } },
    Select: { defaultProps: { size: "xs" } },
    NativeSelect: { defaultProps: { size: "xs" } },
    Table: { defaultProps: { verticalSpacing: 6, horizontalSpacing: 10, fz: 13 } },
    Tooltip: {
      defaultProps: {
        openDelay: 300,
        multiline: true,
        maw: 320,
        fz: 12,
        events: { hover: true, focus: true, touch: true },
      },
    },
  },
});
